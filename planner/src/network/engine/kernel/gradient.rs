//! The gradient of a convolution's kernel.

#[cfg(target_arch = "x86_64")]
use super::lanes::{Avx, Avx512, Sse};
use super::lanes::{Lanes, Portable};
use super::{Isa, OUTSIDE, Table};

/// Pixels whose products are summed in registers before they are added to a kernel's gradient.
const CHUNK_PIXELS: usize = 128;

/// One image's share of the gradient of a kernel.
///
/// # Shapes
/// `x`: (inputs of the table) × `x_channels`; `dy`: (outputs of the table) × `y_channels`; the gradient is laid out
/// as the kernel of [`Gather`].
pub(crate) struct KernelGradient<'a> {
    pub(crate) table: &'a Table,
    pub(crate) x: &'a [f32],
    pub(crate) x_channels: usize,
    pub(crate) dy: &'a [f32],
    pub(crate) y_channels: usize,
}

/// Adds one image's share to a kernel's gradient.
pub(crate) fn kernel_gradient(isa: Isa, job: &KernelGradient<'_>, gradient: &mut [f32]) {
    let (table, x_channels, y_channels) = (job.table, job.x_channels, job.y_channels);
    assert!(y_channels.is_multiple_of(4));
    assert!(job.x.len() >= table.inputs * x_channels);
    assert_eq!(job.dy.len(), table.outputs * y_channels);
    assert_eq!(gradient.len(), table.taps * x_channels * y_channels);
    let width = isa.tile_channels(y_channels);
    // SAFETY: the sizes were checked, and an Isa beyond Portable exists only where it was detected.
    unsafe {
        match (isa, width) {
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512, 32) => gradient_avx512_32(job, gradient),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512, 16) => gradient_avx512_16(job, gradient),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx2, 16) => gradient_avx2_16(job, gradient),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512 | Isa::Avx2, _) => gradient_avx2_4(job, gradient),
            (_, 16) => gradient_tiles::<Portable<8>, 2, 2>(job, gradient),
            _ => gradient_tiles::<Portable<4>, 4, 1>(job, gradient),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn gradient_avx512_32(job: &KernelGradient<'_>, gradient: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gradient_tiles::<Avx512, 8, 2>(job, gradient) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn gradient_avx512_16(job: &KernelGradient<'_>, gradient: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gradient_tiles::<Avx512, 16, 1>(job, gradient) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn gradient_avx2_16(job: &KernelGradient<'_>, gradient: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gradient_tiles::<Avx, 4, 2>(job, gradient) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn gradient_avx2_4(job: &KernelGradient<'_>, gradient: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gradient_tiles::<Sse, 4, 1>(job, gradient) }
}

/// # Safety
/// As [`gather_tiles`].
#[inline(always)]
unsafe fn gradient_tiles<L: Lanes, const CHANNELS: usize, const VECTORS: usize>(
    job: &KernelGradient<'_>,
    gradient: &mut [f32],
) {
    let width = L::N * VECTORS;
    let (taps, x_channels, y_channels) = (job.table.taps, job.x_channels, job.y_channels);
    let outputs = job.table.outputs;
    let whole = x_channels - x_channels % CHANNELS;
    for first in (0..outputs).step_by(CHUNK_PIXELS) {
        let last = outputs.min(first + CHUNK_PIXELS);
        for tap in 0..taps {
            let mut pairs = [(0_usize, 0_usize); CHUNK_PIXELS];
            let mut count = 0;
            for output in first..last {
                let source = job.table.sources[tap * outputs + output];
                if source != OUTSIDE {
                    pairs[count] = (
                        source as usize * x_channels,
                        job.table.place(output) * y_channels,
                    );
                    count += 1;
                }
            }
            let pairs = &pairs[..count];
            for tile in 0..y_channels / width {
                let base = (tile * taps + tap) * x_channels;
                // SAFETY: channels stay below x_channels and the tile below y_channels.
                unsafe {
                    for channel in (0..whole).step_by(CHANNELS) {
                        let at = ((base + channel) * width, channel, tile * width);
                        gradient_tile::<L, CHANNELS, VECTORS>(job, pairs, at, gradient);
                    }
                    for channel in whole..x_channels {
                        let at = ((base + channel) * width, channel, tile * width);
                        gradient_tile::<L, 1, VECTORS>(job, pairs, at, gradient);
                    }
                }
            }
        }
    }
}

/// # Safety
/// As [`gather_tiles`]; pairs are offsets of pixels in `x` and `dy`, and from `(at, channel, tile)` a
/// tile of `CHANNELS` × `L::N * VECTORS` fits.
#[inline(always)]
unsafe fn gradient_tile<L: Lanes, const CHANNELS: usize, const VECTORS: usize>(
    job: &KernelGradient<'_>,
    pairs: &[(usize, usize)],
    (at, channel, tile): (usize, usize, usize),
    gradient: &mut [f32],
) {
    let width = L::N * VECTORS;
    // SAFETY: as the caller's.
    unsafe {
        let to = gradient.as_mut_ptr().add(at);
        let mut sums = [[L::splat(0.0); VECTORS]; CHANNELS];
        for &(source, output) in pairs {
            let x = job.x.as_ptr().add(source + channel);
            let dy = job.dy.as_ptr().add(output + tile);
            let mut factors = [L::splat(0.0); VECTORS];
            for (vector, factor) in factors.iter_mut().enumerate() {
                *factor = L::load(dy.add(vector * L::N));
            }
            for (offset, sum) in sums.iter_mut().enumerate() {
                let value = L::splat(*x.add(offset));
                for vector in 0..VECTORS {
                    sum[vector] = L::mul_add(value, factors[vector], sum[vector]);
                }
            }
        }
        for (offset, sum) in sums.iter().enumerate() {
            for (vector, &value) in sum.iter().enumerate() {
                let place = to.add(offset * width + vector * L::N);
                L::store(place, L::add(value, L::load(place)));
            }
        }
    }
}
