//! Normalisation over the batch with dropout, residual and activation, forward and backward.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;
use rayon::prelude::*;

use super::Training;
use crate::network::engine::kernel::Isa;
use crate::network::engine::kernel::channelwise::{
    Affine, BackwardSums, Before, Combination, apply, backward_input, backward_sums, moments,
    pattern,
};
use crate::network::graph::{Activation, NORM_EPSILON, Norm};
use crate::network::parameters::Parameters;

/// What a normalisation remembers between forward and backward.
#[derive(Debug, Clone, Default)]
pub(super) struct Statistics {
    pub(super) mean: Vec<f32>,
    pub(super) variance: Vec<f32>,
    /// Factor of each image and channel; empty without dropout.
    keep: Vec<f32>,
}

impl Training {
    pub(super) fn norm(
        &mut self,
        norm: &Norm,
        index: usize,
        parameters: &Parameters,
        random: Option<&mut ChaCha8Rng>,
    ) {
        let (isa, len, channels) = (self.isa, self.len(norm.x), norm.channels);
        let mut statistics = std::mem::take(&mut self.statistics[index]);
        let images = self.activations[norm.x].par_chunks_exact(len);
        let moments: Vec<_> = images.map(|x| image_moments(isa, x, channels)).collect();
        let images = moments.len() as f64;
        statistics.mean.resize(channels, 0.0);
        statistics.variance.resize(channels, 0.0);
        for channel in 0..channels {
            let of_image = || moments.iter().map(|moments| moments[channel]);
            let mean = of_image().map(|(mean, _)| mean).sum::<f64>() / images;
            let spread = |(of_image, variance): (f64, f64)| variance + (of_image - mean).powi(2);
            let variance = of_image().map(spread).sum::<f64>() / images;
            statistics.mean[channel] = narrow(mean);
            statistics.variance[channel] = narrow(variance);
        }
        statistics.keep.clear();
        if let Some(random) = random.filter(|_| norm.dropout > 0.0) {
            let keep = || draw_keep(random, norm.dropout);
            statistics
                .keep
                .extend(std::iter::repeat_with(keep).take(self.batch * channels));
        }
        let mut y = std::mem::take(&mut self.activations[norm.y]);
        let images = self.activations[norm.x].par_chunks_exact(len);
        let images = images.zip(y.par_chunks_exact_mut(len)).enumerate();
        images.for_each(|(image, (x, y))| {
            let coefficients = affine(norm, &statistics, parameters.values(), image);
            let residual = norm
                .residual
                .map(|buffer| &self.activations[buffer][image * len..(image + 1) * len]);
            apply(isa, &coefficients, x, residual, y);
        });
        self.activations[norm.y] = y;
        self.statistics[index] = statistics;
    }

    pub(super) fn norm_backward(
        &mut self,
        (norm, index): (&Norm, usize),
        parameters: &Parameters,
        written: &mut [bool],
        gradient: &mut [f32],
    ) {
        let (isa, len, values) = (self.isa, self.len(norm.x), parameters.values());
        let mut dz = self.take_gradient(norm.y);
        let statistics = &self.statistics[index];
        let images = self.activations[norm.x].par_chunks_exact(len);
        let images = images.zip(dz.par_chunks_exact_mut(len)).enumerate();
        let sums: Vec<BackwardSums> = images
            .map(|(image, (x, dy))| {
                let before = Before {
                    affine: &affine(norm, statistics, values, image),
                    mean: &pattern(&statistics.mean),
                    x,
                    residual: norm
                        .residual
                        .map(|buffer| &self.activations[buffer][image * len..(image + 1) * len]),
                };
                let mut sums = BackwardSums::new(norm.channels);
                backward_sums(isa, &before, dy, &mut sums);
                sums
            })
            .collect();
        let totals = totals(norm, statistics, &sums);
        add_gradients(norm, statistics, &totals, gradient);
        let mut dx = self.take_gradient(norm.x);
        let count = (self.batch * self.graph.buffers[norm.x].pixels()) as f64;
        let statistics = &self.statistics[index];
        let images = self.activations[norm.x].par_chunks_exact(len);
        images
            .zip(dz.par_chunks_exact(len))
            .zip(dx.par_chunks_exact_mut(len))
            .enumerate()
            .for_each(|(image, ((x, dz), dx))| {
                let combination = combination((norm, values), statistics, (&totals, count), image);
                backward_input(isa, &combination, x, dz, dx);
            });
        written[norm.x] = true;
        self.give_gradient(norm.x, dx);
        if let Some(residual) = norm.residual {
            let mut to = self.take_gradient(residual);
            let add = std::mem::replace(&mut written[residual], true);
            let images = to.par_chunks_exact_mut(len).zip(dz.par_chunks_exact(len));
            images.for_each(|(to, dz)| {
                if add {
                    to.iter_mut().zip(dz).for_each(|(to, dz)| *to += dz);
                } else {
                    to.copy_from_slice(dz);
                }
            });
            self.give_gradient(residual, to);
        }
        self.give_gradient(norm.y, dz);
    }
}

/// The coefficients of one image.
fn affine(norm: &Norm, statistics: &Statistics, values: &[f32], image: usize) -> Affine {
    let channels = norm.channels;
    let (scale, shift) = values[norm.scale..][..2 * channels].split_at(channels);
    let keep = |channel: usize| {
        let keep = statistics.keep.get(image * channels + channel);
        keep.copied().unwrap_or(1.0)
    };
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
fn image_moments(isa: Isa, x: &[f32], channels: usize) -> Vec<(f64, f64)> {
    let floor = &x[..channels];
    let (mut sums, mut squares) = (vec![0.0; channels], vec![0.0; channels]);
    moments(isa, x, &pattern(floor), &mut sums, &mut squares);
    let count = (x.len() / channels) as f64;
    let of_channel = |channel: usize| {
        let mean = sums[channel] / count;
        let variance = (squares[channel] / count - mean * mean).max(0.0);
        (f64::from(floor[channel]) + mean, variance)
    };
    (0..channels).map(of_channel).collect()
}

/// Sums over the batch: gradient of shift, gradient of scale over the inverse deviation, slope.
fn totals(norm: &Norm, statistics: &Statistics, sums: &[BackwardSums]) -> BackwardSums {
    let mut totals = BackwardSums::new(norm.channels);
    for (image, sums) in sums.iter().enumerate() {
        for channel in 0..norm.channels {
            let keep = statistics.keep.get(image * norm.channels + channel);
            let keep = f64::from(keep.copied().unwrap_or(1.0));
            totals.gradient[channel] += keep * sums.gradient[channel];
            totals.centred[channel] += keep * sums.centred[channel];
            totals.slope[channel] += sums.slope[channel];
        }
    }
    totals
}

fn add_gradients(
    norm: &Norm,
    statistics: &Statistics,
    totals: &BackwardSums,
    gradient: &mut [f32],
) {
    for channel in 0..norm.channels {
        let inverse = f64::from(inverse_deviation(statistics.variance[channel]));
        gradient[norm.scale + channel] += narrow(totals.centred[channel] * inverse);
        gradient[norm.scale + norm.channels + channel] += narrow(totals.gradient[channel]);
        if let Activation::Prelu(start) = norm.activation {
            gradient[start + channel] += narrow(totals.slope[channel]);
        }
    }
}

/// The coefficients of the gradient at the input: with u = keep · dz and x̂ the normalised input,
/// dx = scale / deviation · (u − mean(u) − x̂ · mean(u · x̂)).
fn combination(
    (norm, values): (&Norm, &[f32]),
    statistics: &Statistics,
    (totals, count): (&BackwardSums, f64),
    image: usize,
) -> Combination {
    let channels = norm.channels;
    let mut outer = vec![0.0; channels];
    let mut inner = vec![0.0; channels];
    let mut constant = vec![0.0; channels];
    for channel in 0..channels {
        let inverse = f64::from(inverse_deviation(statistics.variance[channel]));
        let gain = f64::from(values[norm.scale + channel]) * inverse;
        let keep = statistics.keep.get(image * channels + channel);
        let slope = -gain * inverse * inverse * totals.centred[channel] / count;
        outer[channel] = narrow(gain * f64::from(keep.copied().unwrap_or(1.0)));
        inner[channel] = narrow(slope);
        let mean = f64::from(statistics.mean[channel]);
        constant[channel] = narrow(-gain * totals.gradient[channel] / count - slope * mean);
    }
    Combination {
        outer: pattern(&outer),
        inner: pattern(&inner),
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
