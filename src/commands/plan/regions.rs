//! The predicted regions of a plan as a `NumPy` array.

use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::Context;
use swath_planner::network::Network;
use swath_planner::{FrameInput, PlanConfig};

/// Alignment of the values in a `NumPy` file, bytes.
const ALIGNMENT: usize = 64;
/// Bytes before the header's text: the magic, the version and the header's length.
const PREFIX: usize = 10;

/// Writes the probability of each cell to lie in the region of the path to each target.
///
/// The file is an array of targets × rows × cols in single precision, row 0 farthest ahead.
pub(super) fn write(
    path: &Path,
    input: &FrameInput<'_>,
    network: Option<&Network>,
    config: &PlanConfig,
) -> anyhow::Result<()> {
    let network = network.with_context(|| {
        format!(
            "--regions needs a method that uses a network, such as tiev-fcn; {} uses none",
            config.method.name()
        )
    })?;
    let regions = input.region_probabilities(network, config.speed_m_per_s)?;
    let (rows, cols) = (input.spec.rows, input.spec.cols);
    let context = || path.display().to_string();
    let file = std::fs::File::create(path).with_context(context)?;
    let mut file = BufWriter::new(file);
    file.write_all(&header(&[regions.len(), rows as usize, cols as usize]))
        .with_context(context)?;
    for value in regions.iter().flatten() {
        file.write_all(&value.to_le_bytes()).with_context(context)?;
    }
    file.flush().with_context(context)
}

/// The header of an array of single precision, after version 1.0 of `NumPy`'s format.
fn header(shape: &[usize]) -> Vec<u8> {
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let text = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({},), }}",
        sides.join(", ")
    );
    let len = (PREFIX + text.len() + 1).next_multiple_of(ALIGNMENT) - PREFIX;
    let padded = format!("{text:<width$}\n", width = len - 1);
    let len = u16::try_from(len).expect("three numbers are short");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(len.to_le_bytes());
    bytes.extend(padded.bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_is_aligned_and_says_the_shape() {
        let bytes = header(&[2, 401, 151]);
        assert_eq!(bytes.len() % ALIGNMENT, 0);
        assert_eq!(
            usize::from(u16::from_le_bytes([bytes[8], bytes[9]])),
            bytes.len() - PREFIX
        );
        let text = String::from_utf8_lossy(&bytes[PREFIX..]).into_owned();
        assert!(text.contains("'shape': (2, 401, 151,)"), "{text}");
        assert!(text.ends_with('\n'));
    }
}
