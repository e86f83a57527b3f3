//! `swath report`: recordings to tables, plots and a report.

use std::path::{Path, PathBuf};

use swath_analysis::{ReportOptions as AnalysisOptions, Summary, report};

use crate::cli::ReportOptions;
use crate::output::{self, Failure};
use crate::{outputs, progress};

/// Runs the command.
pub(crate) fn run(options: &ReportOptions) -> Result<(), Failure> {
    let summary = write(&options.files, &options.out)?;
    if options.json {
        output::json(&summary)?;
    } else {
        for line in summary.lines() {
            output::line(line)?;
        }
        output::line(format_args!(
            "written: {}",
            options.out.join("report.md").display()
        ))?;
    }
    Ok(())
}

/// Writes the report of recordings into a directory.
pub(crate) fn write(recordings: &[PathBuf], out: &Path) -> anyhow::Result<Summary> {
    outputs::test_folder(out)?;
    let bar = progress::bar(0, "report");
    let summary = report(recordings, out, &AnalysisOptions::default(), |progress| {
        bar.set_length(progress.total_bytes);
        bar.set_position(progress.read_bytes);
    });
    bar.finish_and_clear();
    Ok(summary?)
}
