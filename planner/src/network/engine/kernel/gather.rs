//! Convolution as a gather of pixels.

use std::mem::MaybeUninit;

#[cfg(target_arch = "x86_64")]
use super::lanes::{Avx, Avx512, Sse};
use super::lanes::{Lanes, Portable};
use super::{Isa, MAX_CHANNELS, OUTSIDE, Table};

/// Most pixels of a tile.
const MAX_PIXELS: usize = 24;
/// Inputs of fewer channels are gathered for all taps before anything is multiplied.
const FEW_CHANNELS: usize = 16;
/// Most taps.
const MAX_TAPS: usize = 9;
/// Most taps times channels of the input.
const MAX_DEPTH: usize = 9 * 32;
/// Floats that are gathered for a tile.
const GATHERED: usize = MAX_PIXELS * MAX_DEPTH;

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

/// One image's convolution, or those outputs of it that are counted from `first` on.
///
/// # Shapes
/// `x`: (inputs of the table) × `x_channels`; `y`: outputs × `y_channels`; `kernel`: tiles of
/// `y_channels` × taps × `x_channels` × [`Isa::tile_channels`]; bias and slope: `y_channels`; a
/// residual is as long as `y`.
#[derive(Clone, Copy)]
pub(crate) struct Gather<'a> {
    pub(crate) table: &'a Table,
    pub(crate) first: usize,
    pub(crate) x: &'a [f32],
    pub(crate) x_channels: usize,
    pub(crate) y_channels: usize,
    pub(crate) kernel: &'a [f32],
    pub(crate) epilogue: Epilogue<'a>,
}

impl Gather<'_> {
    /// The outputs from `first` on.
    pub(crate) fn from(self, first: usize) -> Self {
        let skipped = first * self.y_channels;
        let epilogue = match self.epilogue {
            Epilogue::Finish {
                bias,
                slope,
                residual,
            } => Epilogue::Finish {
                bias,
                slope,
                residual: residual.map(|residual| &residual[skipped..]),
            },
            other => other,
        };
        Self {
            first: self.first + first,
            epilogue,
            ..self
        }
    }

    fn check(&self, y: &[f32]) {
        let (table, y_channels) = (self.table, self.y_channels);
        assert!(self.x_channels <= MAX_CHANNELS && y_channels.is_multiple_of(4));
        assert!(table.taps <= MAX_TAPS && table.taps * self.x_channels <= MAX_DEPTH);
        assert!(self.x.len() >= table.inputs * self.x_channels);
        assert!(y.len().is_multiple_of(y_channels));
        assert!(self.first + y.len() / y_channels <= table.outputs);
        // Outputs that do not lie as they are counted can only be computed together.
        assert!(table.places.is_empty() || y.len() == table.outputs * y_channels);
        assert_eq!(self.kernel.len(), table.taps * self.x_channels * y_channels);
        if let Epilogue::Finish {
            bias,
            slope,
            residual,
        } = self.epilogue
        {
            assert!(bias.len() >= y_channels && slope.len() >= y_channels);
            assert!(residual.is_none_or(|residual| residual.len() >= y.len()));
        }
    }
}

/// Computes one image's convolution into `y`.
pub(crate) fn gather(isa: Isa, job: &Gather<'_>, y: &mut [f32]) {
    job.check(y);
    let width = isa.tile_channels(job.y_channels);
    if (job.x_channels, job.y_channels) == (4, 4) {
        // SAFETY: as below.
        return unsafe { gather_quads(isa, job, y) };
    }
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
    unsafe { gather_tiles::<Avx512, 20, 1>(job, y) }
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
    unsafe { gather_tiles::<Sse, 10, 1>(job, y) }
}

/// Four channels to four.
///
/// # Safety
/// The job has been checked against `y`, and the instructions exist.
unsafe fn gather_quads(isa: Isa, job: &Gather<'_>, y: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => quads_avx512(job, y),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => quads_avx2(job, y),
            Isa::Portable => each_quad::<Portable<4>>(job, y),
            #[cfg(not(target_arch = "x86_64"))]
            _ => each_quad::<Portable<4>>(job, y),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn quads_avx512(job: &Gather<'_>, y: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { each_quad::<Avx512>(job, y) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn quads_avx2(job: &Gather<'_>, y: &mut [f32]) {
    // SAFETY: as the caller's.
    unsafe { each_quad::<Avx>(job, y) }
}

/// A register holds the four channels of several pixels.
///
/// # Safety
/// The job has been checked against `y` and has four channels on both sides; `L`'s instructions exist.
#[inline(always)]
unsafe fn each_quad<L: Lanes>(job: &Gather<'_>, y: &mut [f32]) {
    let pixels = L::N / 4;
    let (taps, outputs) = (job.table.taps, job.table.outputs);
    let mut copied;
    let mut sums = [0.0_f32; 16];
    let wanted = y.len() / 4;
    for first in (0..wanted).step_by(pixels) {
        let count = pixels.min(wanted - first);
        // SAFETY: all offsets stay within what check() has verified.
        unsafe {
            let mut sum = L::splat(0.0);
            for tap in 0..taps {
                let at = tap * outputs + job.first + first;
                let source = *job.table.sources.get_unchecked(at);
                let run = usize::from(*job.table.runs.get_unchecked(at));
                let block = if source == OUTSIDE && run >= count {
                    continue;
                } else if run >= pixels {
                    job.x.as_ptr().add(source as usize * 4)
                } else {
                    copied = [0.0_f32; 16];
                    for pixel in 0..count {
                        let source = *job.table.sources.get_unchecked(at + pixel);
                        if source != OUTSIDE {
                            let from = job.x.as_ptr().add(source as usize * 4);
                            let to = copied.as_mut_ptr().add(pixel * 4);
                            std::ptr::copy_nonoverlapping(from, to, 4);
                        }
                    }
                    copied.as_ptr()
                };
                let values = L::load(block);
                let kernel = job.kernel.as_ptr().add(tap * 16);
                sum = L::mul_add(L::spread::<0>(values), L::load_quad(kernel), sum);
                sum = L::mul_add(L::spread::<1>(values), L::load_quad(kernel.add(4)), sum);
                sum = L::mul_add(L::spread::<2>(values), L::load_quad(kernel.add(8)), sum);
                sum = L::mul_add(L::spread::<3>(values), L::load_quad(kernel.add(12)), sum);
            }
            if count == pixels && job.table.places.is_empty() {
                finish_quads::<L>(job, first * 4, sum, y.as_mut_ptr());
                continue;
            }
            L::store(sums.as_mut_ptr(), sum);
            for pixel in 0..count {
                let sum = [Quad::load(sums.as_ptr().add(pixel * 4))];
                let at = job.table.place(first + pixel) * 4;
                finish::<Quad, 1>(job, (at, 0), &sum, y.as_mut_ptr());
            }
        }
    }
}

/// # Safety
/// As [`each_quad`]; `L::N` floats from `at` on lie within `y`.
#[inline(always)]
unsafe fn finish_quads<L: Lanes>(job: &Gather<'_>, at: usize, sum: L::V, y: *mut f32) {
    // SAFETY: as the caller's.
    unsafe {
        let to = y.add(at);
        let value = match job.epilogue {
            Epilogue::Store => sum,
            Epilogue::Add => L::add(sum, L::load(to)),
            Epilogue::Finish {
                bias,
                slope,
                residual,
            } => {
                let mut z = L::add(sum, L::load_quad(bias.as_ptr()));
                if let Some(residual) = residual {
                    z = L::add(z, L::load(residual.as_ptr().add(at)));
                }
                L::leak(z, L::load_quad(slope.as_ptr()))
            }
        };
        L::store(to, value);
    }
}

/// The four channels of one pixel.
type Quad = Portable<4>;

/// # Safety
/// The job has been checked against `y`, `L`'s instructions exist, `y_channels` is a multiple of
/// `L::N * VECTORS`, and every source in the table is below `inputs` or [`OUTSIDE`].
#[inline(always)]
unsafe fn gather_tiles<L: Lanes, const PIXELS: usize, const VECTORS: usize>(
    job: &Gather<'_>,
    y: &mut [f32],
) {
    // A constant distance between pixels becomes part of the instructions.
    // SAFETY: as the caller's.
    unsafe {
        match job.x_channels {
            16 => each_tile::<L, PIXELS, VECTORS, 16>(job, y),
            32 => each_tile::<L, PIXELS, VECTORS, 32>(job, y),
            64 => each_tile::<L, PIXELS, VECTORS, 64>(job, y),
            128 => each_tile::<L, PIXELS, VECTORS, 128>(job, y),
            _ => each_tile::<L, PIXELS, VECTORS, 0>(job, y),
        }
    }
}

/// Tiles of pixels × channels of the output; `CHANNELS` of the input, 0 if known at run time only.
///
/// # Safety
/// As [`gather_tiles`].
#[inline(always)]
unsafe fn each_tile<L: Lanes, const PIXELS: usize, const VECTORS: usize, const CHANNELS: usize>(
    job: &Gather<'_>,
    y: &mut [f32],
) {
    let width = L::N * VECTORS;
    let taps = job.table.taps;
    let channels = if CHANNELS > 0 {
        CHANNELS
    } else {
        job.x_channels
    };
    #[expect(
        clippy::large_stack_arrays,
        reason = "27 kB that are neither cleared nor allocated"
    )]
    let mut gathered = Gathered([MaybeUninit::uninit(); GATHERED]);
    let mut blocks = [(std::ptr::null(), 0); MAX_TAPS];
    let wanted = y.len() / job.y_channels;
    for first in (0..wanted).step_by(PIXELS) {
        let count = PIXELS.min(wanted - first);
        // SAFETY: all offsets stay within what check() has verified.
        unsafe {
            let whole = channels < FEW_CHANNELS;
            let (blocks, length) = if whole {
                gather_all(job, (first, count), &mut gathered);
                blocks[0] = (gathered.at(0), 0);
                (&blocks[..1], taps * channels)
            } else {
                let tile = (first, count, PIXELS);
                let found = find_blocks::<CHANNELS>(job, tile, &mut gathered, &mut blocks);
                (&blocks[..found], channels)
            };
            for tile in 0..job.y_channels / width {
                let kernel = job.kernel.as_ptr().add(tile * taps * channels * width);
                let sums = if CHANNELS > 0 {
                    multiply::<L, PIXELS, VECTORS>(blocks, kernel, (CHANNELS, CHANNELS))
                } else {
                    multiply::<L, PIXELS, VECTORS>(blocks, kernel, (length, length))
                };
                for (pixel, sum) in sums.iter().enumerate().take(count) {
                    let at = job.table.place(first + pixel) * job.y_channels + tile * width;
                    finish::<L, VECTORS>(job, (at, tile * width), sum, y.as_mut_ptr());
                }
            }
        }
    }
}

/// Memory for what is gathered for a tile.
#[repr(align(64))]
struct Gathered([MaybeUninit<f32>; GATHERED]);

impl Gathered {
    /// Where a float is kept. Panics beyond the end.
    fn at(&mut self, index: usize) -> *mut f32 {
        self.0[index..].as_mut_ptr().cast()
    }
}

/// For each tap that reads anything where its inputs for a tile of pixels lie beside each other, as
/// they are or copied, and where its part of the kernel begins. Returns how many there are.
///
/// # Safety
/// The pixels lie within the table, sources are below `inputs`.
#[inline(always)]
unsafe fn find_blocks<const CHANNELS: usize>(
    job: &Gather<'_>,
    (first, count, pixels): (usize, usize, usize),
    gathered: &mut Gathered,
    blocks: &mut [(*const f32, usize); MAX_TAPS],
) -> usize {
    let channels = if CHANNELS > 0 {
        CHANNELS
    } else {
        job.x_channels
    };
    let mut found = 0;
    let mut copied = 0;
    for tap in 0..job.table.taps {
        let at = tap * job.table.outputs + job.first + first;
        // SAFETY: as the caller's.
        unsafe {
            let source = *job.table.sources.get_unchecked(at);
            let run = usize::from(*job.table.runs.get_unchecked(at));
            let block = if source == OUTSIDE && run >= count {
                continue;
            } else if run >= pixels {
                job.x.as_ptr().add(source as usize * channels)
            } else {
                let sources = job.table.sources.get_unchecked(at..at + count);
                let block = gathered.at(copied);
                copied += pixels * channels;
                copy_pixels::<CHANNELS>(job, sources, block);
                block.cast_const()
            };
            blocks[found] = (block, tap * channels);
        }
        found += 1;
    }
    found
}

/// # Safety
/// Sources are below `inputs`, and there is room for them.
#[inline(always)]
unsafe fn copy_pixels<const CHANNELS: usize>(job: &Gather<'_>, sources: &[u32], block: *mut f32) {
    let channels = if CHANNELS > 0 {
        CHANNELS
    } else {
        job.x_channels
    };
    for (pixel, &source) in sources.iter().enumerate() {
        // SAFETY: as the caller's.
        unsafe {
            let to = block.add(pixel * channels);
            if source == OUTSIDE {
                std::ptr::write_bytes(to, 0, channels);
            } else {
                let from = job.x.as_ptr().add(source as usize * channels);
                std::ptr::copy_nonoverlapping(from, to, channels);
            }
        }
    }
}

/// Copies what all taps read for a tile of pixels: the taps of one pixel beside each other.
///
/// # Safety
/// As [`find_blocks`].
#[inline(always)]
unsafe fn gather_all(job: &Gather<'_>, (first, count): (usize, usize), gathered: &mut Gathered) {
    let (taps, channels) = (job.table.taps, job.x_channels);
    let block = gathered.at(0);
    for tap in 0..taps {
        for pixel in 0..count {
            // SAFETY: as the caller's.
            unsafe {
                let at = tap * job.table.outputs + job.first + first + pixel;
                let source = *job.table.sources.get_unchecked(at);
                let to = block.add((pixel * taps + tap) * channels);
                if source == OUTSIDE {
                    for channel in 0..channels {
                        *to.add(channel) = 0.0;
                    }
                } else {
                    let from = job.x.as_ptr().add(source as usize * channels);
                    for channel in 0..channels {
                        *to.add(channel) = *from.add(channel);
                    }
                }
            }
        }
    }
}

/// The sums of products of blocks of pixels, `stride` floats from one pixel to the next, and the
/// parts of a kernel that begin at so many rows.
///
/// # Safety
/// `L`'s instructions exist; blocks have `PIXELS` pixels of `channels` floats, and the kernel as many
/// rows of `L::N * VECTORS` floats behind each beginning.
#[inline(always)]
unsafe fn multiply<L: Lanes, const PIXELS: usize, const VECTORS: usize>(
    blocks: &[(*const f32, usize)],
    kernel: *const f32,
    (stride, channels): (usize, usize),
) -> [[L::V; VECTORS]; PIXELS] {
    // SAFETY: as the caller's.
    unsafe {
        let mut sums = [[L::splat(0.0); VECTORS]; PIXELS];
        for &(block, begin) in blocks {
            let kernel = kernel.add(begin * VECTORS * L::N);
            for channel in 0..channels {
                let mut factors = [L::splat(0.0); VECTORS];
                for (vector, factor) in factors.iter_mut().enumerate() {
                    *factor = L::load(kernel.add((channel * VECTORS + vector) * L::N));
                }
                for (pixel, sum) in sums.iter_mut().enumerate() {
                    let value = L::splat(*block.add(pixel * stride + channel));
                    for (sum, &factor) in sum.iter_mut().zip(&factors) {
                        *sum = L::mul_add(value, factor, *sum);
                    }
                }
            }
        }
        sums
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
