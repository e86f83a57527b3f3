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

mod assistant;
pub(crate) mod channelwise;
mod gather;
mod gradient;
mod lanes;

use std::sync::OnceLock;

pub(crate) use assistant::{Assistant, with_assistant};
pub(crate) use gather::{Epilogue, Gather, gather};
pub(crate) use gradient::{KernelGradient, kernel_gradient};

/// Marks a tap that lies outside the input.
pub(crate) const OUTSIDE: u32 = u32::MAX;
/// Most channels of a pixel.
pub(crate) const MAX_CHANNELS: usize = 128;
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
            let has_avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq");
            return if has_avx512 {
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
///
/// Outputs are counted in an order in which neighbours read neighbours, which is not always that in
/// which they lie.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Table {
    taps: usize,
    outputs: usize,
    /// Every source is below this or [`OUTSIDE`]; the kernels rely on it.
    inputs: usize,
    /// Output pixels of one tap beside each other.
    sources: Vec<u32>,
    /// From each place on, how many outputs read inputs that lie beside each other, or none.
    runs: Vec<u8>,
    /// Where each output lies; empty if they lie as they are counted.
    places: Vec<u32>,
}

impl Table {
    /// The table of `sources`, the output pixels of one tap beside each other, for outputs that lie at
    /// `places`, or in their order if there are none.
    ///
    /// A source or a place beyond the image panics: it would be a mistake in building the table.
    pub(crate) fn new(taps: usize, inputs: usize, sources: Vec<u32>, places: Vec<u32>) -> Self {
        let inside = |source: u32| source == OUTSIDE || (source as usize) < inputs;
        assert!(taps > 0 && sources.len().is_multiple_of(taps));
        assert!(sources.iter().all(|&source| inside(source)));
        let outputs = sources.len() / taps;
        assert!(places.is_empty() || places.len() == outputs);
        assert!(places.iter().all(|&place| (place as usize) < outputs));
        let mut runs = vec![1_u8; sources.len()];
        for of_tap in 0..taps {
            for output in (0..outputs.saturating_sub(1)).rev() {
                let at = of_tap * outputs + output;
                let goes_on = if sources[at] == OUTSIDE {
                    sources[at + 1] == OUTSIDE
                } else {
                    sources[at + 1] == sources[at] + 1
                };
                if goes_on {
                    runs[at] = runs[at + 1].saturating_add(1);
                }
            }
        }
        Self {
            taps,
            outputs,
            inputs,
            sources,
            runs,
            places,
        }
    }

    /// Where an output lies.
    #[inline]
    fn place(&self, output: usize) -> usize {
        self.places
            .get(output)
            .map_or(output, |&place| place as usize)
    }
}

/// Runs a loop compiled for an instruction set. What it calls has to be inlined into it.
pub(crate) fn compiled_for<R>(isa: Isa, run: impl FnOnce() -> R) -> R {
    // SAFETY: an Isa beyond Portable exists only where it was detected.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => for_avx512(run),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => for_avx2(run),
            _ => run(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma")]
unsafe fn for_avx512<R>(run: impl FnOnce() -> R) -> R {
    run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn for_avx2<R>(run: impl FnOnce() -> R) -> R {
    run()
}
