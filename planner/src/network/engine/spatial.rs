//! Operations on one image that change its size: pooling, upsampling, the head.

#![expect(
    clippy::inline_always,
    reason = "a loop must be compiled within the function that enables its instructions"
)]

use crate::network::graph::{Extent, GOAL_FEATURES, NEAR_GOAL};

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

/// Means of each channel over the pixels: all alike, then weighted.
fn means(x: &[f32], channels: usize, weights: &[f32]) -> Vec<f32> {
    let mut means = vec![0.0; 2 * channels];
    let (plain, weighted) = means.split_at_mut(channels);
    let share = 1.0 / weights.len() as f32;
    for (x, weight) in x.chunks_exact(channels).zip(weights) {
        for (channel, &x) in x.iter().enumerate() {
            plain[channel] += x * share;
            weighted[channel] += x * weight;
        }
    }
    means
}

/// How much each pixel counts near the goal; all together count 1, or nothing far off the grid.
fn near_goal(features: &[f32]) -> Vec<f32> {
    let near = features.chunks_exact(GOAL_FEATURES);
    let mut weights: Vec<f32> = near.map(|pixel| pixel[NEAR_GOAL].max(0.0)).collect();
    let sum: f32 = weights.iter().sum();
    for weight in &mut weights {
        *weight /= sum.max(1e-6);
    }
    weights
}

/// The scores of a goal.
///
/// # Shapes
/// `kernel`: scores × (2 × channels), the biases behind it; `features`: pixels × 20.
pub(super) fn scores(
    (x, channels): (&[f32], usize),
    features: &[f32],
    (kernel, bias): (&[f32], &[f32]),
    y: &mut [f32],
) {
    let means = means(x, channels, &near_goal(features));
    for ((y, kernel), bias) in y.iter_mut().zip(kernel.chunks_exact(means.len())).zip(bias) {
        let products = kernel.iter().zip(&means).map(|(a, b)| a * b);
        *y = bias + products.sum::<f32>();
    }
}

/// Adds the gradient at the input of [`scores`] and those of kernel and biases, which lie behind it.
pub(super) fn scores_backward(
    (x, channels): (&[f32], usize),
    features: &[f32],
    (kernel, dy): (&[f32], &[f32]),
    dx: &mut [f32],
    gradient: &mut [f32],
) {
    let weights = near_goal(features);
    let means = means(x, channels, &weights);
    let share = 1.0 / weights.len() as f32;
    let (kernel_gradient, bias_gradient) = gradient.split_at_mut(kernel.len());
    let lines = kernel.chunks_exact(2 * channels);
    let gradients = kernel_gradient.chunks_exact_mut(2 * channels);
    let mut at_means = vec![0.0; 2 * channels];
    for (((kernel, gradient), bias), &dy) in lines.zip(gradients).zip(bias_gradient).zip(dy) {
        *bias += dy;
        for (index, (kernel, gradient)) in kernel.iter().zip(gradient).enumerate() {
            *gradient += dy * means[index];
            at_means[index] += dy * kernel;
        }
    }
    let (plain, weighted) = at_means.split_at(channels);
    for (dx, weight) in dx.chunks_exact_mut(channels).zip(&weights) {
        for (channel, dx) in dx.iter_mut().enumerate() {
            *dx += plain[channel] * share + weighted[channel] * weight;
        }
    }
}

const fn head_place(pixel: usize, corner: usize, cols: usize) -> usize {
    let row = pixel / cols * 2 + corner / 2;
    let col = pixel % cols * 2 + corner % 2;
    row * cols * 2 + col
}
