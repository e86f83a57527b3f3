//! From recordings to a directory: the report, its tables and its plots.

use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use polars::prelude::{CsvWriter, DataFrame, ParquetWriter, SerWriter as _};

use crate::agreement::agreements;
use crate::comparison::comparisons;
use crate::error::InTable as _;
use crate::format::count;
use crate::frames::{counts, names};
use crate::grid::{Grid, escape_markdown};
use crate::health::Health;
use crate::methods::methods;
use crate::pairwise::{Pairwise, pairwise};
use crate::plots::{self, Sources};
use crate::read::{Progress, read};
use crate::results;
use crate::sections::{self, Section};
use crate::summary::Summary;
use crate::tables::Tables;
use crate::{Error, ReportOptions};

const TABLE: &str = "report";

/// Reads the recordings and writes `report.md`, `tables.tex`, `tables/*.csv`, `tables/*.parquet` and
/// `plots/*.svg` into `out_dir`, which is made if it is missing. The same recordings give the same
/// files.
///
/// # Errors
/// [`Error`] says which recording cannot be read or holds nothing of swath's, which file cannot be
/// written, or which table outgrew its limit. Messages that do not decode are counted in the report.
pub fn report(
    recordings: &[PathBuf],
    out_dir: &Path,
    options: &ReportOptions,
    progress: impl FnMut(&Progress<'_>),
) -> Result<Summary, Error> {
    let tables = read(recordings, options, progress)?;
    let names: Vec<String> = recordings.iter().map(|path| file_name(path)).collect();
    write(&tables, &names, out_dir, options)
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(
        || path.display().to_string(),
        |name| name.to_string_lossy().into_owned(),
    )
}

fn write(
    tables: &Tables,
    recordings: &[String],
    out_dir: &Path,
    options: &ReportOptions,
) -> Result<Summary, Error> {
    let comparisons = comparisons(tables, &options.baseline)?;
    let pairwise = pairwise(tables, &options.baseline)?;
    let agreements = agreements(&tables.evaluations)?;
    let health = Health::of(tables)?;
    let (tables_dir, plots_dir) = (out_dir.join("tables"), out_dir.join("plots"));
    for directory in [&tables_dir, &plots_dir] {
        fs::create_dir_all(directory).map_err(|source| Error::Write {
            path: directory.clone(),
            source,
        })?;
    }
    let sources = Sources {
        tables,
        comparisons: &comparisons,
        agreements: &agreements,
        health: &health,
        baseline: &options.baseline,
    };
    let drawn = plots::draw(&sources, &plots_dir)?;
    let sections = sections(&sources, &pairwise, &drawn)?;
    let mut written = Vec::new();
    let inputs = inputs(tables, recordings)?;
    write_text(
        out_dir,
        "report.md",
        &markdown(options, &inputs, &sections),
        &mut written,
    )?;
    write_text(out_dir, "tables.tex", &latex(&sections), &mut written)?;
    for (name, frame) in tables.named() {
        write_frame(&tables_dir, name, frame, &mut written)?;
    }
    for (name, frame) in results::frames(&comparisons, &pairwise, &agreements, &health)? {
        write_frame(&tables_dir, name, &frame, &mut written)?;
    }
    written.extend(drawn.iter().map(|file| plots_dir.join(file)));
    Ok(Summary::new(
        tables,
        &comparisons,
        &agreements,
        &health,
        written,
    ))
}

fn sections(
    sources: &Sources<'_>,
    pairwise: &[Pairwise],
    drawn: &[String],
) -> Result<[Section; 5], Error> {
    let methods = methods(&sources.tables.plans)?;
    let mut one_target = sections::one_target::section(sources.comparisons, &methods);
    one_target.plot(drawn, "search_time.svg", "Search time, one target");
    one_target.plot(drawn, "search_steps.svg", "Expansions, one target");
    Ok([
        one_target,
        sections::target_counts::section(sources.comparisons, drawn),
        sections::pairwise::section(pairwise),
        sections::agreement::section(sources.agreements, drawn),
        sections::health::section(sources.health, drawn),
    ])
}

fn markdown(options: &ReportOptions, inputs: &str, sections: &[Section]) -> String {
    let title = escape_markdown(&options.title);
    let mut text = format!("# {title}\n\n{inputs}");
    for section in sections {
        text.push_str(&section.text);
    }
    let trimmed = text.trim_end().len();
    text.truncate(trimmed);
    text.push('\n');
    text
}

/// What the report was made from, and what in it could not be read.
fn inputs(tables: &Tables, recordings: &[String]) -> Result<String, Error> {
    let of = counts(&tables.topics, "recording", TABLE)?;
    let topics = names(&tables.topics, "topic", TABLE)?;
    let messages = counts(&tables.topics, "messages", TABLE)?;
    let undecodable = counts(&tables.topics, "undecodable", TABLE)?;
    let mut grid = Grid::new(["recording", "topics", "messages", "undecodable"]);
    for (recording, name) in (0u64..).zip(recordings) {
        let rows = || (0..topics.len()).filter(|row| of[*row] == recording);
        grid.row([
            name.clone(),
            count(rows().count() as u64),
            count(rows().map(|row| messages[row]).sum()),
            count(rows().map(|row| undecodable[row]).sum()),
        ]);
    }
    Ok(format!(
        "Computed from recordings alone. Every table is in `tables/` as CSV and Parquet, the main \
         ones in `tables.tex`. Spreads are given as median (lower–upper quartile).\n\n{}",
        grid.markdown()
    ))
}

fn latex(sections: &[Section]) -> String {
    let mut text = String::from("% Needs \\usepackage{booktabs}.\n");
    for table in sections.iter().flat_map(|section| &section.tables) {
        text.push('\n');
        text.push_str(&table.grid.latex(&table.label, &table.caption));
    }
    text
}

fn write_text(
    directory: &Path,
    file: &str,
    text: &str,
    written: &mut Vec<PathBuf>,
) -> Result<(), Error> {
    let path = directory.join(file);
    fs::write(&path, text).map_err(|source| Error::Write {
        path: path.clone(),
        source,
    })?;
    written.push(path);
    Ok(())
}

fn write_frame(
    directory: &Path,
    name: &'static str,
    frame: &DataFrame,
    written: &mut Vec<PathBuf>,
) -> Result<(), Error> {
    let mut frame = frame.clone();
    let path = directory.join(format!("{name}.csv"));
    let mut file = create(&path)?;
    CsvWriter::new(&mut file)
        .finish(&mut frame)
        .in_table(name)?;
    flush(&mut file, &path)?;
    written.push(path);
    let path = directory.join(format!("{name}.parquet"));
    let mut file = create(&path)?;
    ParquetWriter::new(&mut file)
        .finish(&mut frame)
        .in_table(name)?;
    flush(&mut file, &path)?;
    written.push(path);
    Ok(())
}

fn create(path: &Path) -> Result<BufWriter<File>, Error> {
    let file = File::create(path).map_err(|source| Error::Write {
        path: path.to_owned(),
        source,
    })?;
    Ok(BufWriter::new(file))
}

fn flush(file: &mut BufWriter<File>, path: &Path) -> Result<(), Error> {
    file.flush().map_err(|source| Error::Write {
        path: path.to_owned(),
        source,
    })
}
