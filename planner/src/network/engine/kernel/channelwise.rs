//! Loops over pixels that treat each channel alike: normalisation forward and backward.
//!
//! Coefficients come as a pattern of [`PATTERN`] floats in which the channels repeat, so that one
//! loop of a fixed length serves every number of channels.

use super::Isa;

/// Length of a pattern; every number of channels in use divides it.
pub(crate) const PATTERN: usize = 128;

/// One coefficient a channel, repeated.
pub(crate) type Pattern = [f32; PATTERN];

/// Repeats one coefficient a channel. The number of channels has to divide [`PATTERN`].
pub(crate) fn pattern(coefficients: &[f32]) -> Pattern {
    debug_assert!(PATTERN.is_multiple_of(coefficients.len()));
    std::array::from_fn(|index| coefficients[index % coefficients.len()])
}

/// Adds up a pattern's entries of the same channel.
fn fold(sums: &Pattern, channels: &mut [f64]) {
    let count = channels.len();
    for (index, &sum) in sums.iter().enumerate() {
        channels[index % count] += f64::from(sum);
    }
}

macro_rules! for_each_isa {
    ($(#[$doc:meta])* fn $name:ident / $avx2:ident / $avx512:ident = $body:ident
     ($($arg:ident: $type:ty),* $(,)?)) => {
        $(#[$doc])*
        pub(crate) fn $name(isa: Isa, $($arg: $type),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn $avx2($($arg: $type),*) {
                    $body($($arg),*);
                }
                #[target_feature(enable = "avx512f,avx2,fma")]
                fn $avx512($($arg: $type),*) {
                    $body($($arg),*);
                }
                match isa {
                    // SAFETY: an Isa beyond Portable exists only where it was detected.
                    Isa::Avx512 => return unsafe { $avx512($($arg),*) },
                    // SAFETY: as above.
                    Isa::Avx2 => return unsafe { $avx2($($arg),*) },
                    Isa::Portable => {}
                }
            }
            let _ = isa;
            $body($($arg),*);
        }
    };
}

for_each_isa! {
    /// Adds one image's sums and sums of squares a channel, of what lies above `floor`.
    fn moments / moments_avx2 / moments_avx512 = moments_body(
        x: &[f32],
        floor: &Pattern,
        sums: &mut [f64],
        squares: &mut [f64],
    )
}

#[inline(always)]
fn moments_body(x: &[f32], floor: &Pattern, sums: &mut [f64], squares: &mut [f64]) {
    let (mut first, mut second) = ([0.0; PATTERN], [0.0; PATTERN]);
    for chunk in x.chunks(PATTERN) {
        for (lane, &x) in chunk.iter().enumerate() {
            let above = x - floor[lane];
            first[lane] += above;
            second[lane] += above * above;
        }
    }
    fold(&first, sums);
    fold(&second, squares);
}

/// The coefficients of `activation(gain * x + offset + residual)`.
#[derive(Debug, Clone)]
pub(crate) struct Affine {
    pub(crate) gain: Pattern,
    pub(crate) offset: Pattern,
    /// Slope below zero.
    pub(crate) slope: Pattern,
}

for_each_isa! {
    /// Normalises one image, adds the residual, activates.
    fn apply / apply_avx2 / apply_avx512 = apply_body(
        affine: &Affine,
        x: &[f32],
        residual: Option<&[f32]>,
        y: &mut [f32],
    )
}

#[inline(always)]
fn apply_body(affine: &Affine, x: &[f32], residual: Option<&[f32]>, y: &mut [f32]) {
    let value = |lane: usize, x: f32, residual: f32| {
        let z = affine.gain[lane] * x + affine.offset[lane] + residual;
        if z >= 0.0 { z } else { affine.slope[lane] * z }
    };
    if let Some(residual) = residual {
        let parts = x.chunks(PATTERN).zip(residual.chunks(PATTERN));
        for ((x, residual), y) in parts.zip(y.chunks_mut(PATTERN)) {
            for (lane, ((&x, &residual), y)) in x.iter().zip(residual).zip(y).enumerate() {
                *y = value(lane, x, residual);
            }
        }
    } else {
        for (x, y) in x.chunks(PATTERN).zip(y.chunks_mut(PATTERN)) {
            for (lane, (&x, y)) in x.iter().zip(y).enumerate() {
                *y = value(lane, x, 0.0);
            }
        }
    }
}

/// Sums a channel that the backward pass of a normalisation needs.
#[derive(Debug, Clone)]
pub(crate) struct BackwardSums {
    /// Gradient before the activation.
    pub(crate) gradient: Vec<f64>,
    /// The same times the distance of `x` from its mean.
    pub(crate) centred: Vec<f64>,
    /// Gradient of the slope.
    pub(crate) slope: Vec<f64>,
}

impl BackwardSums {
    pub(crate) fn new(channels: usize) -> Self {
        Self {
            gradient: vec![0.0; channels],
            centred: vec![0.0; channels],
            slope: vec![0.0; channels],
        }
    }
}

/// What the first backward pass reads.
pub(crate) struct Before<'a> {
    pub(crate) affine: &'a Affine,
    pub(crate) mean: &'a Pattern,
    pub(crate) x: &'a [f32],
    pub(crate) residual: Option<&'a [f32]>,
}

for_each_isa! {
    /// Turns the gradient behind the activation into the one before it and adds up what the second
    /// pass needs.
    fn backward_sums / backward_sums_avx2 / backward_sums_avx512 = backward_sums_body(
        before: &Before<'_>,
        dy: &mut [f32],
        sums: &mut BackwardSums,
    )
}

#[inline(always)]
fn backward_sums_body(before: &Before<'_>, dy: &mut [f32], sums: &mut BackwardSums) {
    let Before { affine, mean, .. } = before;
    let mut gradient = [0.0; PATTERN];
    let mut centred = [0.0; PATTERN];
    let mut slope = [0.0; PATTERN];
    let mut step = |lane: usize, x: f32, residual: f32, dy: &mut f32| {
        let z = affine.gain[lane] * x + affine.offset[lane] + residual;
        let below = z < 0.0;
        slope[lane] += if below { *dy * z } else { 0.0 };
        let dz = if below { *dy * affine.slope[lane] } else { *dy };
        gradient[lane] += dz;
        centred[lane] += dz * (x - mean[lane]);
        *dy = dz;
    };
    if let Some(residual) = before.residual {
        let parts = before.x.chunks(PATTERN).zip(residual.chunks(PATTERN));
        for ((x, residual), dy) in parts.zip(dy.chunks_mut(PATTERN)) {
            for (lane, ((&x, &residual), dy)) in x.iter().zip(residual).zip(dy).enumerate() {
                step(lane, x, residual, dy);
            }
        }
    } else {
        for (x, dy) in before.x.chunks(PATTERN).zip(dy.chunks_mut(PATTERN)) {
            for (lane, (&x, dy)) in x.iter().zip(dy).enumerate() {
                step(lane, x, 0.0, dy);
            }
        }
    }
    fold(&gradient, &mut sums.gradient);
    fold(&centred, &mut sums.centred);
    fold(&slope, &mut sums.slope);
}

/// `dx = outer * dz + inner * x + constant`.
pub(crate) struct Combination {
    pub(crate) outer: Pattern,
    pub(crate) inner: Pattern,
    pub(crate) constant: Pattern,
}

for_each_isa! {
    /// The gradient at the input of a normalisation.
    fn backward_input / backward_input_avx2 / backward_input_avx512 = backward_input_body(
        combination: &Combination,
        x: &[f32],
        dz: &[f32],
        dx: &mut [f32],
    )
}

#[inline(always)]
fn backward_input_body(combination: &Combination, x: &[f32], dz: &[f32], dx: &mut [f32]) {
    let Combination {
        outer,
        inner,
        constant,
    } = combination;
    let parts = x.chunks(PATTERN).zip(dz.chunks(PATTERN));
    for ((x, dz), dx) in parts.zip(dx.chunks_mut(PATTERN)) {
        for (lane, ((&x, &dz), dx)) in x.iter().zip(dz).zip(dx).enumerate() {
            *dx = outer[lane] * dz + inner[lane] * x + constant[lane];
        }
    }
}
