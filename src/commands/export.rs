//! `swath export`: a network for other runtimes.

use anyhow::Context;
use swath_planner::network::{NetworkInfo, Parameters, to_onnx};

use crate::cli::ExportOptions;
use crate::output::{self, Failure};

/// Runs the command.
pub(crate) fn run(options: &ExportOptions) -> Result<(), Failure> {
    let context = || options.weights.display().to_string();
    let bytes = std::fs::read(&options.weights).with_context(context)?;
    let (parameters, metadata) = Parameters::from_safetensors(&bytes).with_context(context)?;
    let info = NetworkInfo::from_metadata(&metadata).with_context(context)?;
    let onnx = to_onnx(&info, &parameters);
    std::fs::write(&options.onnx, &onnx).with_context(|| options.onnx.display().to_string())?;
    let (rows, cols) = info.encoding().input_size();
    output::line(format_args!(
        "{}: {} for inputs of {rows} x {cols}, {} bytes",
        options.onnx.display(),
        info.architecture.name(),
        onnx.len()
    ))?;
    Ok(())
}
