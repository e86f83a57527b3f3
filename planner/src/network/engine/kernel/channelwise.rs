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

/// Floats that are treated at once.
const LANES: usize = 32;
/// Blocks whose single-precision sums are added up before they go into double precision.
const BLOCKS: usize = 256;

/// Adds up the lanes of the same channel, the first of which is number `first`.
#[inline(always)]
fn fold(sums: &[f32; LANES], first: usize, channels: &mut [f64]) {
    let count = channels.len();
    for (lane, &sum) in sums.iter().enumerate() {
        channels[(first + lane) % count] += f64::from(sum);
    }
}

/// Floats from one block of the same channels to the next: those of a pixel, or of several pixels
/// that have few.
const fn stride(channels: usize) -> usize {
    if channels < LANES { LANES } else { channels }
}

#[inline(always)]
fn lanes(values: &[f32], at: usize) -> &[f32; LANES] {
    values[at..at + LANES]
        .try_into()
        .expect("as long as was asked for")
}

#[inline(always)]
fn lanes_mut(values: &mut [f32], at: usize) -> &mut [f32; LANES] {
    (&mut values[at..at + LANES])
        .try_into()
        .expect("as long as was asked for")
}

/// The last floats of an image whose pixels do not fill a block, and `filler` behind them.
#[inline(always)]
fn filled_up(values: &[f32], filler: &[f32; LANES]) -> [f32; LANES] {
    let mut block = *filler;
    block[..values.len()].copy_from_slice(values);
    block
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
    let stride = stride(sums.len());
    for first in (0..stride).step_by(LANES) {
        let floor = lanes(floor, first);
        for part in x.chunks(BLOCKS * stride) {
            let (mut sum, mut square) = ([0.0; LANES], [0.0; LANES]);
            let mut add = |x: &[f32; LANES]| {
                for lane in 0..LANES {
                    let above = x[lane] - floor[lane];
                    sum[lane] += above;
                    square[lane] += above * above;
                }
            };
            let whole = part.len() - part.len() % LANES;
            for at in (first..whole).step_by(stride) {
                add(lanes(part, at));
            }
            if whole < part.len() {
                add(&filled_up(&part[whole..], floor));
            }
            fold(&sum, first, sums);
            fold(&square, first, squares);
        }
    }
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
    let whole = x.len() - x.len() % LANES;
    let zeros = [0.0; LANES];
    for at in (0..whole).step_by(LANES) {
        let residual = residual.map_or(&zeros, |residual| lanes(residual, at));
        activate(
            affine,
            at % PATTERN,
            (lanes(x, at), residual),
            lanes_mut(y, at),
        );
    }
    if whole < x.len() {
        let x = filled_up(&x[whole..], &zeros);
        let residual = residual.map_or(zeros, |residual| filled_up(&residual[whole..], &zeros));
        let mut last = zeros;
        activate(affine, whole % PATTERN, (&x, &residual), &mut last);
        let y = &mut y[whole..];
        y.copy_from_slice(&last[..y.len()]);
    }
}

#[inline(always)]
fn activate(
    affine: &Affine,
    first: usize,
    (x, residual): (&[f32; LANES], &[f32; LANES]),
    y: &mut [f32; LANES],
) {
    let (gain, offset) = (lanes(&affine.gain, first), lanes(&affine.offset, first));
    let slope = lanes(&affine.slope, first);
    for lane in 0..LANES {
        let z = gain[lane] * x[lane] + offset[lane] + residual[lane];
        y[lane] = if z >= 0.0 { z } else { slope[lane] * z };
    }
}

/// Sums a channel that the backward pass of a normalisation needs.
#[derive(Debug, Clone, Default)]
pub(crate) struct BackwardSums {
    /// Gradient before the activation.
    pub(crate) gradient: Vec<f64>,
    /// The same times the distance of `x` from its mean.
    pub(crate) centred: Vec<f64>,
    /// Gradient of the slope.
    pub(crate) slope: Vec<f64>,
}

impl BackwardSums {
    /// Sums of nothing yet.
    pub(crate) fn clear(&mut self, channels: usize) {
        for sums in [&mut self.gradient, &mut self.centred, &mut self.slope] {
            sums.clear();
            sums.resize(channels, 0.0);
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
    let stride = stride(sums.gradient.len());
    for first in (0..stride).step_by(LANES) {
        for start in (0..dy.len()).step_by(BLOCKS * stride) {
            let end = dy.len().min(start + BLOCKS * stride);
            let dy = &mut dy[start..end];
            let x = &before.x[start..end];
            if let Some(residual) = before.residual {
                sum_blocks(
                    before,
                    (first, stride),
                    (x, Some(&residual[start..end])),
                    (dy, sums),
                );
            } else {
                sum_blocks(before, (first, stride), (x, None), (dy, sums));
            }
        }
    }
}

/// The blocks that begin at channel `first`.
#[inline(always)]
fn sum_blocks(
    before: &Before<'_>,
    (first, stride): (usize, usize),
    (x, residual): (&[f32], Option<&[f32]>),
    (dy, sums): (&mut [f32], &mut BackwardSums),
) {
    let (gain, offset) = (
        lanes(&before.affine.gain, first),
        lanes(&before.affine.offset, first),
    );
    let (slope, mean) = (
        lanes(&before.affine.slope, first),
        lanes(before.mean, first),
    );
    let zeros = [0.0; LANES];
    let mut of_gradient = zeros;
    let mut of_centred = zeros;
    let mut of_slope = zeros;
    let mut add = |x: &[f32; LANES], residual: &[f32; LANES], dy: &mut [f32; LANES]| {
        for lane in 0..LANES {
            let z = gain[lane] * x[lane] + offset[lane] + residual[lane];
            let below = z < 0.0;
            of_slope[lane] += if below { dy[lane] * z } else { 0.0 };
            let dz = if below {
                dy[lane] * slope[lane]
            } else {
                dy[lane]
            };
            of_gradient[lane] += dz;
            of_centred[lane] += dz * (x[lane] - mean[lane]);
            dy[lane] = dz;
        }
    };
    let whole = x.len() - x.len() % LANES;
    for at in (first..whole).step_by(stride) {
        let residual = residual.map_or(&zeros, |residual| lanes(residual, at));
        add(lanes(x, at), residual, lanes_mut(dy, at));
    }
    if whole < x.len() {
        let x = filled_up(&x[whole..], &zeros);
        let residual = residual.map_or(zeros, |residual| filled_up(&residual[whole..], &zeros));
        // A gradient of 0 adds nothing to any sum.
        let mut last = filled_up(&dy[whole..], &zeros);
        add(&x, &residual, &mut last);
        let dy = &mut dy[whole..];
        dy.copy_from_slice(&last[..dy.len()]);
    }
    fold(&of_gradient, first, &mut sums.gradient);
    fold(&of_centred, first, &mut sums.centred);
    fold(&of_slope, first, &mut sums.slope);
}

/// `dx = outer * dz + inner * (x - mean) + constant`.
pub(crate) struct Combination {
    pub(crate) outer: Pattern,
    pub(crate) inner: Pattern,
    pub(crate) mean: Pattern,
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
    let whole = x.len() - x.len() % LANES;
    for at in (0..whole).step_by(LANES) {
        combine(
            combination,
            at % PATTERN,
            (lanes(x, at), lanes(dz, at)),
            lanes_mut(dx, at),
        );
    }
    if whole < x.len() {
        let zeros = [0.0; LANES];
        let (x, dz) = (
            filled_up(&x[whole..], &zeros),
            filled_up(&dz[whole..], &zeros),
        );
        let mut last = zeros;
        combine(combination, whole % PATTERN, (&x, &dz), &mut last);
        let dx = &mut dx[whole..];
        dx.copy_from_slice(&last[..dx.len()]);
    }
}

#[inline(always)]
fn combine(
    combination: &Combination,
    first: usize,
    (x, dz): (&[f32; LANES], &[f32; LANES]),
    dx: &mut [f32; LANES],
) {
    let (outer, inner) = (
        lanes(&combination.outer, first),
        lanes(&combination.inner, first),
    );
    let (mean, constant) = (
        lanes(&combination.mean, first),
        lanes(&combination.constant, first),
    );
    for lane in 0..LANES {
        let centred = x[lane] - mean[lane];
        dx[lane] = outer[lane] * dz[lane] + inner[lane] * centred + constant[lane];
    }
}
