//! Normalisation over the batch with dropout: its statistics, and the coefficients of each image.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;

use crate::network::engine::kernel::Isa;
use crate::network::engine::kernel::channelwise::{
    Affine, BackwardSums, Combination, moments, pattern,
};
use crate::network::graph::{Activation, NORM_EPSILON, Norm};

/// Mean and variance of each channel of one image.
pub(super) type Moments = Vec<(f64, f64)>;

/// What a normalisation remembers between forward and backward.
#[derive(Debug, Clone, Default)]
pub(super) struct Statistics {
    pub(super) mean: Vec<f32>,
    pub(super) variance: Vec<f32>,
    /// Factor of each image and channel; empty without dropout.
    keep: Vec<f32>,
    /// Sums over the batch in the backward pass.
    totals: BackwardSums,
}

impl Statistics {
    /// The statistics of a batch from those of its images.
    pub(super) fn collect(&mut self, images: &[&Moments]) {
        let count = images.len() as f64;
        let channels = images.first().map_or(0, |moments| moments.len());
        self.mean.resize(channels, 0.0);
        self.variance.resize(channels, 0.0);
        for channel in 0..channels {
            let of_images = images.iter().map(|moments| moments[channel]);
            let mean = of_images.clone().map(|(mean, _)| mean).sum::<f64>() / count;
            let spread = |(of_image, variance): (f64, f64)| variance + (of_image - mean).powi(2);
            let variance = of_images.map(spread).sum::<f64>() / count;
            self.mean[channel] = narrow(mean);
            self.variance[channel] = narrow(variance);
        }
    }

    /// Draws which channels of which images are dropped.
    pub(super) fn drop_channels(
        &mut self,
        norm: &Norm,
        batch: usize,
        random: Option<&mut ChaCha8Rng>,
    ) {
        self.keep.clear();
        if let Some(random) = random.filter(|_| norm.dropout > 0.0) {
            let keep = std::iter::repeat_with(|| draw_keep(random, norm.dropout));
            self.keep.extend(keep.take(batch * norm.channels));
        }
    }

    fn keep(&self, index: usize) -> f32 {
        self.keep.get(index).copied().unwrap_or(1.0)
    }

    /// Sums over the batch: gradient of shift, gradient of scale over the inverse deviation, slope.
    pub(super) fn sum_up<'a>(
        &mut self,
        norm: &Norm,
        images: impl Iterator<Item = &'a BackwardSums>,
    ) {
        let mut totals = std::mem::take(&mut self.totals);
        totals.clear(norm.channels);
        for (image, sums) in images.enumerate() {
            for channel in 0..norm.channels {
                let keep = f64::from(self.keep(image * norm.channels + channel));
                totals.gradient[channel] += keep * sums.gradient[channel];
                totals.centred[channel] += keep * sums.centred[channel];
                totals.slope[channel] += sums.slope[channel];
            }
        }
        self.totals = totals;
    }

    /// Adds the gradients of scale, shift and slope.
    pub(super) fn add_gradients(&self, norm: &Norm, gradient: &mut [f32]) {
        for channel in 0..norm.channels {
            let inverse = f64::from(inverse_deviation(self.variance[channel]));
            gradient[norm.scale + channel] += narrow(self.totals.centred[channel] * inverse);
            gradient[norm.scale + norm.channels + channel] += narrow(self.totals.gradient[channel]);
            if let Activation::Prelu(start) = norm.activation {
                gradient[start + channel] += narrow(self.totals.slope[channel]);
            }
        }
    }
}

/// The coefficients of one image.
pub(super) fn image_affine(
    norm: &Norm,
    statistics: &Statistics,
    values: &[f32],
    image: usize,
) -> Affine {
    let channels = norm.channels;
    let (scale, shift) = values[norm.scale..][..2 * channels].split_at(channels);
    let keep = |channel: usize| statistics.keep(image * channels + channel);
    let gain: Vec<f32> = (0..channels)
        .map(|c| keep(c) * scale[c] * inverse_deviation(statistics.variance[c]))
        .collect();
    let offset: Vec<f32> = (0..channels)
        .map(|c| keep(c) * shift[c] - gain[c] * statistics.mean[c])
        .collect();
    Affine {
        gain: pattern(&gain),
        offset: pattern(&offset),
        slope: pattern(&slopes(norm, values)),
    }
}

/// `1 / sqrt(variance + ε)`.
pub(in crate::network::engine) fn inverse_deviation(variance: f32) -> f32 {
    1.0 / (variance + NORM_EPSILON).sqrt()
}

/// Slope below zero of each channel.
pub(in crate::network::engine) fn slopes(norm: &Norm, values: &[f32]) -> Vec<f32> {
    match norm.activation {
        Activation::Identity => vec![1.0; norm.channels],
        Activation::Relu => vec![0.0; norm.channels],
        Activation::Prelu(start) => values[start..][..norm.channels].to_vec(),
    }
}

/// Mean and variance of each channel of one image. Squares are taken above the first pixel, so that a
/// mean far from 0 does not drown the variance.
pub(super) fn image_moments(isa: Isa, x: &[f32], channels: usize, to: &mut Moments) {
    let floor = &x[..channels];
    let (mut sums, mut squares) = (vec![0.0; channels], vec![0.0; channels]);
    moments(isa, x, &pattern(floor), &mut sums, &mut squares);
    let count = (x.len() / channels) as f64;
    to.clear();
    to.extend((0..channels).map(|channel| {
        let mean = sums[channel] / count;
        let variance = (squares[channel] / count - mean * mean).max(0.0);
        (f64::from(floor[channel]) + mean, variance)
    }));
}

/// The coefficients of the gradient at the input: with u = keep · dz and x̂ the normalised input,
/// dx = scale / deviation · (u − mean(u) − x̂ · mean(u · x̂)).
pub(super) fn combination(
    (norm, values): (&Norm, &[f32]),
    statistics: &Statistics,
    (count, image): (usize, usize),
) -> Combination {
    let (channels, totals, count) = (norm.channels, &statistics.totals, count as f64);
    let mut outer = vec![0.0; channels];
    let mut inner = vec![0.0; channels];
    let mut constant = vec![0.0; channels];
    for channel in 0..channels {
        let inverse = f64::from(inverse_deviation(statistics.variance[channel]));
        let gain = f64::from(values[norm.scale + channel]) * inverse;
        let keep = f64::from(statistics.keep(image * channels + channel));
        let slope = -gain * inverse * inverse * totals.centred[channel] / count;
        outer[channel] = narrow(gain * keep);
        inner[channel] = narrow(slope);
        constant[channel] = narrow(-gain * totals.gradient[channel] / count);
    }
    Combination {
        outer: pattern(&outer),
        inner: pattern(&inner),
        mean: pattern(&statistics.mean),
        constant: pattern(&constant),
    }
}

fn draw_keep(random: &mut ChaCha8Rng, dropout: f32) -> f32 {
    let unit = (random.next_u32() >> 8) as f32 / (1_u32 << 24) as f32;
    if unit < dropout {
        0.0
    } else {
        1.0 / (1.0 - dropout)
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "sums are kept in double precision, parameters in single"
)]
fn narrow(value: f64) -> f32 {
    value as f32
}
