//! Operations on one image that change its size: pooling, upsampling, the head.

#![expect(
    clippy::inline_always,
    reason = "a loop must be compiled within the function that enables its instructions"
)]

use crate::network::graph::Extent;

/// 2×2 maximum of `x` into the channels of `y` from `offset`.
pub(super) fn pool_input(
    x: &[f32],
    from: Extent,
    y: &mut [f32],
    (channels, offset): (usize, usize),
) {
    let cols = from.cols / 2;
    for (pixel, y) in y.chunks_exact_mut(channels).enumerate() {
        let (row, col) = (pixel / cols * 2, pixel % cols * 2);
        let corner = |dr: usize, dc: usize, channel: usize| {
            x[((row + dr) * from.cols + col + dc) * from.channels + channel]
        };
        for channel in 0..from.channels {
            let top = corner(0, 0, channel).max(corner(0, 1, channel));
            let bottom = corner(1, 0, channel).max(corner(1, 1, channel));
            y[offset + channel] = top.max(bottom);
        }
    }
}

/// 2×2 mean; channels of `y` that `x` lacks become 0.
#[inline(always)]
pub(super) fn pool(x: &[f32], from: Extent, y: &mut [f32], channels: usize) {
    let (cols, len) = (from.cols / 2, from.channels);
    let line = from.cols * len;
    for (pixel, y) in y.chunks_exact_mut(channels).enumerate() {
        let start = pixel / cols * 2 * line + pixel % cols * 2 * len;
        let top = x[start..start + 2 * len].split_at(len);
        let bottom = x[start + line..start + line + 2 * len].split_at(len);
        let (copied, padded) = y.split_at_mut(len);
        for (channel, y) in copied.iter_mut().enumerate() {
            let sum = top.0[channel] + top.1[channel] + bottom.0[channel] + bottom.1[channel];
            *y = 0.25 * sum;
        }
        padded.fill(0.0);
    }
}

/// Adds the gradient of [`pool`].
#[inline(always)]
pub(super) fn pool_backward(dy: &[f32], channels: usize, dx: &mut [f32], from: Extent) {
    let (cols, len) = (from.cols / 2, from.channels);
    for (pixel, dy) in dy.chunks_exact(channels).enumerate() {
        for corner in 0..4 {
            let row = pixel / cols * 2 + corner / 2;
            let col = pixel % cols * 2 + corner % 2;
            let start = (row * from.cols + col) * len;
            for (dx, &dy) in dx[start..start + len].iter_mut().zip(dy) {
                *dx += 0.25 * dy;
            }
        }
    }
}

/// The two input lines that an output line lies between when doubled bilinearly, and the share of
/// the nearer one's partner: corners are not aligned and edges are clamped, as in `PyTorch`.
pub(crate) const fn bilinear_lines(output: usize, inputs: usize) -> (usize, usize) {
    let near = output / 2;
    let far = if output.is_multiple_of(2) {
        near.saturating_sub(1)
    } else if near + 1 < inputs {
        near + 1
    } else {
        near
    };
    (near, far)
}

/// Share of the nearer line in a doubled image.
pub(crate) const NEAR: f32 = 0.75;
/// Share of the other line.
pub(crate) const FAR: f32 = 0.25;

/// Bilinear to twice the size.
#[inline(always)]
pub(super) fn upsample(x: &[f32], from: Extent, y: &mut [f32]) {
    let len = from.channels;
    let line = from.cols * len;
    for (row, y) in y.chunks_exact_mut(2 * line).enumerate() {
        let (near, far) = bilinear_lines(row, from.rows);
        let (near, far) = (&x[near * line..][..line], &x[far * line..][..line]);
        for (col, y) in y.chunks_exact_mut(len).enumerate() {
            let (near_col, far_col) = bilinear_lines(col, from.cols);
            let (near_at, far_at) = (near_col * len, far_col * len);
            let (a, b) = (&near[near_at..][..len], &near[far_at..][..len]);
            let (c, d) = (&far[near_at..][..len], &far[far_at..][..len]);
            for channel in 0..len {
                y[channel] = NEAR * (NEAR * a[channel] + FAR * b[channel])
                    + FAR * (NEAR * c[channel] + FAR * d[channel]);
            }
        }
    }
}

/// Adds the gradient of [`upsample`].
#[inline(always)]
pub(super) fn upsample_backward(dy: &[f32], dx: &mut [f32], from: Extent) {
    let len = from.channels;
    let (rows, cols) = (from.rows * 2, from.cols * 2);
    for row in 0..rows {
        let (near_row, far_row) = bilinear_lines(row, from.rows);
        for col in 0..cols {
            let (near_col, far_col) = bilinear_lines(col, from.cols);
            let dy = &dy[(row * cols + col) * len..][..len];
            for (row, row_share) in [(near_row, NEAR), (far_row, FAR)] {
                for (col, share) in [(near_col, row_share * NEAR), (far_col, row_share * FAR)] {
                    let dx = &mut dx[(row * from.cols + col) * len..][..len];
                    for (dx, &dy) in dx.iter_mut().zip(dy) {
                        *dx += share * dy;
                    }
                }
            }
        }
    }
}

/// Transposed convolution 2×2 to one logit at twice the size.
///
/// # Shapes
/// `kernel`: channels × 4, the four places of the 2×2 block beside each other.
#[inline(always)]
pub(super) fn head(x: &[f32], from: Extent, (kernel, bias): (&[f32], f32), y: &mut [f32]) {
    let lines = x.chunks_exact(from.cols * from.channels);
    for (x, y) in lines.zip(y.chunks_exact_mut(4 * from.cols)) {
        let (top, bottom) = y.split_at_mut(2 * from.cols);
        let pixels = x.chunks_exact(from.channels);
        let corners = top.chunks_exact_mut(2).zip(bottom.chunks_exact_mut(2));
        for (x, (top, bottom)) in pixels.zip(corners) {
            let mut sums = [bias; 4];
            for (&x, kernel) in x.iter().zip(kernel.chunks_exact(4)) {
                for (sum, &weight) in sums.iter_mut().zip(kernel) {
                    *sum += x * weight;
                }
            }
            top.copy_from_slice(&sums[..2]);
            bottom.copy_from_slice(&sums[2..]);
        }
    }
}

/// Stores the gradient at the input of [`head`] and adds those of kernel and bias, which lies last.
pub(super) fn head_backward(
    (x, from): (&[f32], Extent),
    kernel: &[f32],
    dy: &[f32],
    dx: &mut [f32],
    gradient: &mut [f32],
) {
    let (kernel_gradient, bias_gradient) = gradient.split_at_mut(kernel.len());
    let pixels = x.chunks_exact(from.channels);
    for (pixel, (x, dx)) in pixels.zip(dx.chunks_exact_mut(from.channels)).enumerate() {
        let dy: [f32; 4] = std::array::from_fn(|corner| dy[head_place(pixel, corner, from.cols)]);
        bias_gradient[0] += dy.iter().sum::<f32>();
        for (channel, (&x, dx)) in x.iter().zip(dx).enumerate() {
            let kernel = &kernel[channel * 4..][..4];
            let gradient = &mut kernel_gradient[channel * 4..][..4];
            *dx = 0.0;
            for corner in 0..4 {
                *dx += kernel[corner] * dy[corner];
                gradient[corner] += x * dy[corner];
            }
        }
    }
}

const fn head_place(pixel: usize, corner: usize, cols: usize) -> usize {
    let row = pixel / cols * 2 + corner / 2;
    let col = pixel % cols * 2 + corner % 2;
    row * cols * 2 + col
}
