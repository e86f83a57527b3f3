//! Convolution as a gather of pixels.

mod quads;
mod tiles;

#[cfg(target_arch = "x86_64")]
use super::lanes::{Avx, Avx512, Sse};
use super::lanes::{Lanes, Portable};
use super::{Isa, MAX_CHANNELS, Table};
use quads::each_quad;
use tiles::gather_tiles;

/// Most taps.
const MAX_TAPS: usize = 9;
/// Most taps times channels of the input.
const MAX_DEPTH: usize = 9 * 32;

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

/// # Safety
/// The job has been checked against `y`, `L`'s instructions exist; `at` plus the tile lies within `y`, `channel` plus the tile in `y_channels`.
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
