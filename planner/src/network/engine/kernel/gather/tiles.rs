//! Tiles of pixels × channels of the output, whose sums stay in registers over all taps.

use std::mem::MaybeUninit;

use super::super::OUTSIDE;
use super::super::lanes::Lanes;
use super::{Gather, MAX_DEPTH, MAX_TAPS, finish};

/// Most pixels of a tile.
const MAX_PIXELS: usize = 24;
/// Inputs of fewer channels are gathered for all taps before anything is multiplied.
const FEW_CHANNELS: usize = 16;
/// Floats that are gathered for a tile.
const GATHERED: usize = MAX_PIXELS * MAX_DEPTH;

/// # Safety
/// The job has been checked against `y`, `L`'s instructions exist, `y_channels` is a multiple of
/// `L::N * VECTORS`, and every source in the table is below `inputs` or [`OUTSIDE`].
#[inline(always)]
pub(super) unsafe fn gather_tiles<L: Lanes, const PIXELS: usize, const VECTORS: usize>(
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
