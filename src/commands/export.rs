//! `swath export`: a network for other runtimes.

use anyhow::Context;
use swath_planner::network::to_onnx;

use crate::cli::ExportOptions;
use crate::output::{self, Failure};
use crate::{human, network, outputs};

/// Runs the command.
pub(crate) fn run(options: &ExportOptions) -> Result<(), Failure> {
    outputs::test_apart(&options.onnx, &options.weights)?;
    outputs::test_file(&options.onnx)?;
    let (info, parameters) = network::load_parameters(options.weights.as_deref())?;
    let onnx = to_onnx(&info, &parameters);
    std::fs::write(&options.onnx, &onnx).with_context(|| options.onnx.display().to_string())?;
    let (rows, cols) = info.encoding().input_size();
    output::line(format_args!(
        "{}: {} for inputs of {rows} x {cols}, {}",
        options.onnx.display(),
        info.architecture.name(),
        human::bytes(onnx.len() as u64)
    ))?;
    Ok(())
}
