//! The inner loops: convolution as a gather of pixels, and the gradient of its kernel.
//!
//! A convolution, strided, dilated or transposed, is described by a [`Table`] that names for every
//! output pixel and tap the input pixel it reads, or none. Forward and backward then are the same
//! loop over two tables that are inverse to each other. Pixels have their channels innermost, and a
//! tile of a few pixels × one or two registers of channels stays in registers over the whole sum.
//!
//! This is the one module of the crate that may be `unsafe`: it chooses instructions at run time.

#![expect(
    unsafe_code,
    reason = "vector instructions that are chosen at run time"
)]
#![expect(
    clippy::inline_always,
    reason = "a loop must be compiled within the function that enables its instructions"
)]

pub(crate) mod channelwise;
mod lanes;

use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
use lanes::{Avx, Avx512, Sse};
use lanes::{Lanes, Portable};

/// Marks a tap that lies outside the input.
pub(crate) const OUTSIDE: u32 = u32::MAX;
/// Most channels of a pixel.
pub(crate) const MAX_CHANNELS: usize = 128;
/// Pixels whose products are summed in registers before they are added to a kernel's gradient.
const CHUNK_PIXELS: usize = 128;

static ZERO_PIXEL: [f32; MAX_CHANNELS] = [0.0; MAX_CHANNELS];

/// Instructions that the kernels are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// What every processor of the target has.
    Portable,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// x86-64 with AVX-512.
    Avx512,
}

impl Isa {
    /// The best that this processor has.
    pub fn detect() -> Self {
        static BEST: OnceLock<Isa> = OnceLock::new();
        *BEST.get_or_init(|| *Self::available().last().unwrap_or(&Self::Portable))
    }

    /// All that this processor has, the best last.
    pub fn available() -> &'static [Self] {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return if is_x86_feature_detected!("avx512f") {
                &[Self::Portable, Self::Avx2, Self::Avx512]
            } else {
                &[Self::Portable, Self::Avx2]
            };
        }
        &[Self::Portable]
    }

    /// Output channels that a tile holds when there are `channels` of them, a multiple of 4.
    pub(crate) fn tile_channels(self, channels: usize) -> usize {
        match self {
            _ if !channels.is_multiple_of(16) => 4,
            Self::Avx512 if channels.is_multiple_of(32) => 32,
            _ => 16,
        }
    }
}

/// For every output pixel and tap the input pixel, or [`OUTSIDE`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Table {
    taps: usize,
    /// Every source is below this or [`OUTSIDE`]; the kernels rely on it.
    inputs: usize,
    /// Taps of one output pixel beside each other.
    sources: Vec<u32>,
}

impl Table {
    /// The table of `sources`, the taps of one output pixel beside each other.
    ///
    /// A source beyond the input panics: it would be a mistake in building the table.
    pub(crate) fn new(taps: usize, inputs: usize, sources: Vec<u32>) -> Self {
        let inside = |source: u32| source == OUTSIDE || (source as usize) < inputs;
        assert!(taps > 0 && sources.len().is_multiple_of(taps));
        assert!(sources.iter().all(|&source| inside(source)));
        Self {
            taps,
            inputs,
            sources,
        }
    }

    fn outputs(&self) -> usize {
        self.sources.len() / self.taps
    }
}

/// What is done to a sum before it is stored.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Epilogue<'a> {
    /// Stored as it is.
    Store,
    /// Added to what is there.
    Add,
    /// Bias, residual, activation by slope below zero.
    Finish {
        bias: &'a [f32],
        slope: &'a [f32],
        residual: Option<&'a [f32]>,
    },
}

/// One image's convolution.
///
/// # Shapes
/// `x`: (inputs of the table) × `x_channels`; `y`: (outputs of the table) × `y_channels`; `kernel`:
/// tiles of `y_channels` × taps × `x_channels` × [`Isa::tile_channels`]; bias and slope: `y_channels`.
pub(crate) struct Gather<'a> {
    pub(crate) table: &'a Table,
    pub(crate) x: &'a [f32],
    pub(crate) x_channels: usize,
    pub(crate) y_channels: usize,
    pub(crate) kernel: &'a [f32],
    pub(crate) epilogue: Epilogue<'a>,
}

impl Gather<'_> {
    fn check(&self, y: &[f32]) {
        let (table, y_channels) = (self.table, self.y_channels);
        assert!(self.x_channels <= MAX_CHANNELS && y_channels.is_multiple_of(4));
        assert!(self.x.len() >= table.inputs * self.x_channels);
        assert_eq!(y.len(), table.outputs() * y_channels);
        assert_eq!(self.kernel.len(), table.taps * self.x_channels * y_channels);
        if let Epilogue::Finish {
            bias,
            slope,
            residual,
        } = self.epilogue
        {
            assert!(bias.len() >= y_channels && slope.len() >= y_channels);
            assert!(residual.is_none_or(|residual| residual.len() == y.len()));
        }
    }
}

/// Computes one image's convolution into `y`.
pub(crate) fn gather(isa: Isa, job: &Gather<'_>, y: &mut [f32]) {
    job.check(y);
    let width = isa.tile_channels(job.y_channels);
    // SAFETY: the sizes were checked, and an Isa beyond Portable exists only where it was detected.
    unsafe {
        match (isa, width) {
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512, 32) => gather_avx512_32(job, y),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512, 16) => gather_avx512_16(job, y),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx2, 16) => gather_avx2_16(job, y),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512 | Isa::Avx2, _) => gather_avx2_4(job, y),
            (_, 16) => gather_tiles::<Portable<8>, 3, 2>(job, y),
            _ => gather_tiles::<Portable<4>, 6, 1>(job, y),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn gather_avx512_32(job: &Gather<'_>, y: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gather_tiles::<Avx512, 10, 2>(job, y) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn gather_avx512_16(job: &Gather<'_>, y: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gather_tiles::<Avx512, 12, 1>(job, y) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn gather_avx2_16(job: &Gather<'_>, y: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gather_tiles::<Avx, 6, 2>(job, y) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn gather_avx2_4(job: &Gather<'_>, y: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { gather_tiles::<Sse, 8, 1>(job, y) }
}

/// # Safety
/// The job has been checked against `y`, `L`'s instructions exist, `y_channels` is a multiple of
/// `L::N * VECTORS`, and every source in the table is below `inputs` or [`OUTSIDE`].
#[inline(always)]
unsafe fn gather_tiles<L: Lanes, const PIXELS: usize, const VECTORS: usize>(
    job: &Gather<'_>,
    y: &mut [f32],
) {
    let width = L::N * VECTORS;
    let (taps, x_channels) = (job.table.taps, job.x_channels);
    let outputs = job.table.outputs();
    for first in (0..outputs).step_by(PIXELS) {
        let count = PIXELS.min(outputs - first);
        let sources = &job.table.sources[first * taps..(first + count) * taps];
        for tile in 0..job.y_channels / width {
            // SAFETY: all offsets below stay within what check() has verified.
            unsafe {
                let mut sums = [[L::splat(0.0); VECTORS]; PIXELS];
                for tap in 0..taps {
                    let mut pixels = [ZERO_PIXEL.as_ptr(); PIXELS];
                    let mut inside = false;
                    for (pixel, at) in pixels.iter_mut().enumerate().take(count) {
                        let source = *sources.get_unchecked(pixel * taps + tap);
                        if source != OUTSIDE {
                            inside = true;
                            *at = job.x.as_ptr().add(source as usize * x_channels);
                        }
                    }
                    if !inside {
                        continue;
                    }
                    let kernel = job.kernel.as_ptr();
                    let kernel = kernel.add((tile * taps + tap) * x_channels * width);
                    for channel in 0..x_channels {
                        let mut factors = [L::splat(0.0); VECTORS];
                        for (vector, factor) in factors.iter_mut().enumerate() {
                            *factor = L::load(kernel.add(channel * width + vector * L::N));
                        }
                        for pixel in 0..PIXELS {
                            let value = L::splat(*pixels[pixel].add(channel));
                            for vector in 0..VECTORS {
                                sums[pixel][vector] =
                                    L::mul_add(value, factors[vector], sums[pixel][vector]);
                            }
                        }
                    }
                }
                for (pixel, sum) in sums.iter().enumerate().take(count) {
                    let at = (first + pixel) * job.y_channels + tile * width;
                    finish::<L, VECTORS>(job, (at, tile * width), sum, y.as_mut_ptr());
                }
            }
        }
    }
}

/// # Safety
/// As [`gather_tiles`]; `at` plus the tile lies within `y`, `channel` plus the tile in `y_channels`.
#[inline(always)]
unsafe fn finish<L: Lanes, const VECTORS: usize>(
    job: &Gather<'_>,
    (at, channel): (usize, usize),
    sums: &[L::V; VECTORS],
    y: *mut f32,
) {
    for (vector, &sum) in sums.iter().enumerate() {
        let offset = vector * L::N;
        // SAFETY: as the caller's.
        unsafe {
            let to = y.add(at + offset);
            let value = match job.epilogue {
                Epilogue::Store => sum,
                Epilogue::Add => L::add(sum, L::load(to)),
                Epilogue::Finish {
                    bias,
                    slope,
                    residual,
                } => {
                    let mut z = L::add(sum, L::load(bias.as_ptr().add(channel + offset)));
                    if let Some(residual) = residual {
                        z = L::add(z, L::load(residual.as_ptr().add(at + offset)));
                    }
                    L::leak(z, L::load(slope.as_ptr().add(channel + offset)))
                }
            };
            L::store(to, value);
        }
    }
}

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
    assert_eq!(job.dy.len(), table.outputs() * y_channels);
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
    let outputs = job.table.outputs();
    let whole = x_channels - x_channels % CHANNELS;
    for first in (0..outputs).step_by(CHUNK_PIXELS) {
        let last = outputs.min(first + CHUNK_PIXELS);
        for tap in 0..taps {
            let mut pairs = [(0_usize, 0_usize); CHUNK_PIXELS];
            let mut count = 0;
            for output in first..last {
                let source = job.table.sources[output * taps + tap];
                if source != OUTSIDE {
                    pairs[count] = (source as usize * x_channels, output * y_channels);
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
