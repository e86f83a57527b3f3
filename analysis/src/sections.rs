//! The sections of the report, from values to text.

pub(crate) mod agreement;
pub(crate) mod health;
pub(crate) mod one_target;
pub(crate) mod pairwise;
pub(crate) mod target_counts;

use crate::grid::Grid;

/// A table that also goes into `tables.tex`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Labelled {
    /// Label in LaTeX.
    pub(crate) label: String,
    /// Caption in LaTeX.
    pub(crate) caption: String,
    /// The table.
    pub(crate) grid: Grid,
}

/// A section of the report.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Section {
    /// In Markdown.
    pub(crate) text: String,
    /// Those of its tables that are wanted in LaTeX too.
    pub(crate) tables: Vec<Labelled>,
}

impl Section {
    fn titled(title: &str) -> Self {
        Self {
            text: format!("## {title}\n\n"),
            tables: Vec::new(),
        }
    }

    fn paragraph(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push_str("\n\n");
    }

    fn heading(&mut self, title: &str) {
        self.paragraph(&format!("### {title}"));
    }

    fn table(&mut self, grid: &Grid) {
        self.text.push_str(&grid.markdown());
    }

    fn labelled_table(&mut self, label: String, caption: String, grid: Grid) {
        self.table(&grid);
        self.tables.push(Labelled {
            label,
            caption,
            grid,
        });
    }

    /// Shows a plot, if it was drawn.
    pub(crate) fn plot(&mut self, drawn: &[String], file: &str, title: &str) {
        if drawn.iter().any(|name| name == file) {
            self.paragraph(&format!("![{title}](plots/{file})"));
        }
    }
}
