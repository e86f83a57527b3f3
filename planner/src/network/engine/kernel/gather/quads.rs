//! Four channels to four: a register holds several pixels.

use super::super::OUTSIDE;
use super::super::lanes::{Lanes, Portable};
use super::{Epilogue, Gather, finish};

/// The four channels of one pixel.
type Quad = Portable<4>;

/// A register holds the four channels of several pixels.
///
/// # Safety
/// The job has been checked against `y` and has four channels on both sides; `L`'s instructions exist.
#[inline(always)]
pub(super) unsafe fn each_quad<L: Lanes>(job: &Gather<'_>, y: &mut [f32]) {
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
