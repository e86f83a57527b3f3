//! Tables of pixels for every convolution, and kernels packed as the inner loops want them.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::kernel::{Isa, OUTSIDE, Table};
use crate::network::graph::{Conv, Extent, Graph, Op, Window};

/// The two tables of a convolution, each the inverse of the other.
#[derive(Debug, Clone)]
pub(super) struct Tables {
    /// For each output the inputs.
    pub(super) forward: Arc<Table>,
    /// For each input the outputs.
    pub(super) backward: Arc<Table>,
}

/// The tables of every convolution of a graph, in its order; those of the same geometry are shared.
pub(super) fn tables(graph: &Graph) -> Vec<Tables> {
    let mut known: BTreeMap<(usize, usize, [usize; 7]), Tables> = BTreeMap::new();
    let mut all = Vec::new();
    for op in &graph.ops {
        let Op::Conv(Conv { x, y, window, .. }) = op else {
            continue;
        };
        let (input, output) = (graph.buffers[*x], graph.buffers[*y]);
        let key = (input.rows, input.cols, window_key(window));
        let tables = known
            .entry(key)
            .or_insert_with(|| Tables::new(window, input, output));
        all.push(tables.clone());
    }
    all
}

fn window_key(window: &Window) -> [usize; 7] {
    [
        window.kernel.0,
        window.kernel.1,
        window.padding.0,
        window.padding.1,
        window.stride,
        window.dilation,
        usize::from(window.transposed),
    ]
}

impl Tables {
    fn new(window: &Window, input: Extent, output: Extent) -> Self {
        // The transpose reads where the convolution writes, so it swaps the two tables.
        let (from, to) = if window.transposed {
            (output, input)
        } else {
            (input, output)
        };
        let taps = window.taps();
        // Pixels that lie a stride apart are reached by the same taps.
        let places = in_phases(from, window.stride);
        let mut counted: Vec<usize> = (0..from.pixels()).collect();
        for (index, &place) in places.iter().enumerate() {
            counted[place as usize] = index;
        }
        let mut sources = vec![OUTSIDE; to.pixels() * taps];
        let mut targets = vec![OUTSIDE; from.pixels() * taps];
        for row in 0..to.rows {
            for col in 0..to.cols {
                let pixel = row * to.cols + col;
                for tap in 0..taps {
                    let Some(source) = source_of(window, from, (row, col), tap) else {
                        continue;
                    };
                    sources[tap * to.pixels() + pixel] = index(source);
                    targets[tap * from.pixels() + counted[source]] = index(pixel);
                }
            }
        }
        let gathering = Arc::new(Table::new(taps, from.pixels(), sources, Vec::new()));
        let scattering = Arc::new(Table::new(taps, to.pixels(), targets, places));
        if window.transposed {
            Self {
                forward: scattering,
                backward: gathering,
            }
        } else {
            Self {
                forward: gathering,
                backward: scattering,
            }
        }
    }
}

/// The pixels of an image, those first whose row and column are multiples of the stride, and so on;
/// none for the order in which they lie.
fn in_phases(extent: Extent, stride: usize) -> Vec<u32> {
    if stride == 1 {
        return Vec::new();
    }
    let mut places = Vec::with_capacity(extent.pixels());
    for phase in 0..stride * stride {
        for row in (phase / stride..extent.rows).step_by(stride) {
            for col in (phase % stride..extent.cols).step_by(stride) {
                places.push(index(row * extent.cols + col));
            }
        }
    }
    places
}

fn index(pixel: usize) -> u32 {
    u32::try_from(pixel).expect("an image has fewer than 2^32 pixels")
}

fn source_of(
    window: &Window,
    from: Extent,
    (row, col): (usize, usize),
    tap: usize,
) -> Option<usize> {
    let place = |at: usize, tap: usize, padding: usize, side: usize| {
        (at * window.stride + tap * window.dilation)
            .checked_sub(padding)
            .filter(|&place| place < side)
    };
    let (tap_row, tap_col) = (tap / window.kernel.1, tap % window.kernel.1);
    let row = place(row, tap_row, window.padding.0, from.rows)?;
    let col = place(col, tap_col, window.padding.1, from.cols)?;
    Some(row * from.cols + col)
}

/// Place of a weight in the flat vector.
fn weight_at(conv: &Conv, output: usize, input: usize, tap: usize) -> usize {
    let taps = conv.window.taps();
    let (outer, inner, inners) = if conv.window.transposed {
        (input, output, conv.outputs)
    } else {
        (output, input, conv.inputs)
    };
    conv.kernel + (outer * inners + inner) * taps + tap
}

/// The kernel for the forward pass into `channels` channels, each output scaled.
pub(super) fn pack_forward(
    isa: Isa,
    (conv, channels): (&Conv, usize),
    values: &[f32],
    gain: Option<&[f32]>,
    packed: &mut Vec<f32>,
) {
    let (taps, width) = (conv.window.taps(), isa.tile_channels(channels));
    packed.clear();
    packed.resize(taps * conv.inputs * channels, 0.0);
    for output in 0..conv.outputs {
        let factor = gain.map_or(1.0, |gain| gain[output]);
        for tap in 0..taps {
            for input in 0..conv.inputs {
                let at = packed_at((taps, conv.inputs, width), (output, tap, input));
                packed[at] = factor * values[weight_at(conv, output, input, tap)];
            }
        }
    }
}

/// The kernel for the gradient at the input.
pub(super) fn pack_backward(isa: Isa, conv: &Conv, values: &[f32], packed: &mut Vec<f32>) {
    let (taps, width) = (conv.window.taps(), isa.tile_channels(conv.inputs));
    packed.clear();
    packed.resize(taps * conv.inputs * conv.outputs, 0.0);
    for input in 0..conv.inputs {
        for tap in 0..taps {
            for output in 0..conv.outputs {
                let at = packed_at((taps, conv.outputs, width), (input, tap, output));
                packed[at] = values[weight_at(conv, output, input, tap)];
            }
        }
    }
}

/// Adds a gradient in the layout of [`pack_forward`] to the flat gradient.
pub(super) fn unpack_gradient(
    isa: Isa,
    (conv, channels): (&Conv, usize),
    packed: &[f32],
    gradient: &mut [f32],
) {
    let (taps, width) = (conv.window.taps(), isa.tile_channels(channels));
    for output in 0..conv.outputs {
        for tap in 0..taps {
            for input in 0..conv.inputs {
                let at = packed_at((taps, conv.inputs, width), (output, tap, input));
                gradient[weight_at(conv, output, input, tap)] += packed[at];
            }
        }
    }
}

/// Place in a packed kernel that sums over `inner` channels.
const fn packed_at(
    (taps, inners, width): (usize, usize, usize),
    (outer, tap, inner): (usize, usize, usize),
) -> usize {
    (((outer / width) * taps + tap) * inners + inner) * width + outer % width
}
