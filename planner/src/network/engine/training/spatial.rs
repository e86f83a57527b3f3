//! Pooling, upsampling and the head over a batch, forward and backward.

use rayon::prelude::*;

use super::Training;
use crate::network::engine::kernel::compiled_for;
use crate::network::engine::spatial;
use crate::network::graph::{BufferId, Op};
use crate::network::parameters::Parameters;

impl Training {
    pub(super) fn spatial(&mut self, op: &Op, parameters: &Parameters) {
        if let Op::Add { a, b, y } = *op {
            return self.add(a, b, y);
        }
        let (Op::PoolInput { x, y, .. }
        | Op::Pool { x, y }
        | Op::Upsample { x, y }
        | Op::Head { x, y, .. }) = *op
        else {
            return;
        };
        let (from, channels) = (self.graph.buffers[x], self.graph.buffers[y].channels);
        let (x_len, y_len) = (self.len(x), self.len(y));
        let isa = self.isa;
        let mut output = std::mem::take(&mut self.activations[y]);
        let images = self.activations[x].par_chunks_exact(x_len);
        let images = images.zip(output.par_chunks_exact_mut(y_len));
        images.for_each(|(x, y)| match *op {
            Op::PoolInput { offset, .. } => spatial::pool_input(x, from, y, (channels, offset)),
            Op::Pool { .. } => compiled_for(isa, || spatial::pool(x, from, y, channels)),
            Op::Upsample { .. } => compiled_for(isa, || spatial::upsample(x, from, y)),
            Op::Head { kernel, bias, .. } => {
                let values = parameters.values();
                let kernel = &values[kernel..][..from.channels * 4];
                compiled_for(isa, || spatial::head(x, from, (kernel, values[bias]), y));
            }
            Op::Conv(_) | Op::Norm(_) | Op::Add { .. } => {}
        });
        self.activations[y] = output;
    }

    pub(super) fn spatial_backward(
        &mut self,
        op: &Op,
        parameters: &Parameters,
        written: &mut [bool],
        gradient: &mut [f32],
    ) {
        if let Op::Add { a, b, y } = *op {
            return self.add_backward(a, b, y, written);
        }
        let (Op::Pool { x, y } | Op::Upsample { x, y } | Op::Head { x, y, .. }) = *op else {
            return;
        };
        let (from, channels) = (self.graph.buffers[x], self.graph.buffers[y].channels);
        let (x_len, y_len) = (self.len(x), self.len(y));
        let dy = self.take_gradient(y);
        let mut dx = self.take_gradient(x);
        if !std::mem::replace(&mut written[x], true) {
            dx.fill(0.0);
        }
        let images = dy.par_chunks_exact(y_len);
        let images = images.zip(dx.par_chunks_exact_mut(x_len)).enumerate();
        let head = images.map(|(image, (dy, dx))| match *op {
            Op::Upsample { .. } => {
                spatial::upsample_backward(dy, dx, from);
                Vec::new()
            }
            Op::Head { kernel, .. } => {
                let x = &self.activations[x][image * x_len..(image + 1) * x_len];
                let kernel = &parameters.values()[kernel..][..from.channels * 4];
                let mut gradient = vec![0.0; kernel.len() + 1];
                spatial::head_backward((x, from), kernel, dy, dx, &mut gradient);
                gradient
            }
            _ => {
                spatial::pool_backward(dy, channels, dx, from);
                Vec::new()
            }
        });
        let head: Vec<Vec<f32>> = head.collect();
        if let Op::Head { kernel, .. } = *op {
            // The bias lies right behind the kernel, here and there.
            for image in &head {
                for (to, value) in gradient[kernel..].iter_mut().zip(image) {
                    *to += value;
                }
            }
        }
        self.give_gradient(x, dx);
        self.give_gradient(y, dy);
    }

    fn add(&mut self, a: BufferId, b: BufferId, y: BufferId) {
        let mut output = std::mem::take(&mut self.activations[y]);
        let sums = self.activations[a].par_iter().zip(&self.activations[b]);
        let sums = sums.zip(&mut output).with_min_len(1 << 14);
        sums.for_each(|((a, b), y)| *y = a + b);
        self.activations[y] = output;
    }

    fn add_backward(&mut self, a: BufferId, b: BufferId, y: BufferId, written: &mut [bool]) {
        let dy = self.take_gradient(y);
        for x in [a, b] {
            let mut dx = self.take_gradient(x);
            if std::mem::replace(&mut written[x], true) {
                let both = dx.par_iter_mut().zip(&dy).with_min_len(1 << 14);
                both.for_each(|(dx, dy)| *dx += dy);
            } else {
                dx.copy_from_slice(&dy);
            }
            self.give_gradient(x, dx);
        }
        self.give_gradient(y, dy);
    }
}
