//! A table of text, as Markdown and as LaTeX.

use std::fmt::Write as _;

/// A table of text. Every row has as many cells as the head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Grid {
    /// Titles over several columns each, for LaTeX; empty for none. Together they span all columns.
    groups: Vec<(&'static str, usize)>,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Grid {
    /// A table without rows. Its first column is aligned to the left, all others to the right.
    pub(crate) fn new<T: AsRef<str>>(head: impl IntoIterator<Item = T>) -> Self {
        Self {
            groups: Vec::new(),
            head: head
                .into_iter()
                .map(|cell| cell.as_ref().to_owned())
                .collect(),
            rows: Vec::new(),
        }
    }

    /// Puts titles over groups of columns.
    pub(crate) fn grouped(mut self, groups: &[(&'static str, usize)]) -> Self {
        self.groups = groups.to_vec();
        self
    }

    /// Adds a row; missing cells are empty, cells beyond the head are left out.
    pub(crate) fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        let mut row: Vec<String> = cells.into_iter().take(self.head.len()).collect();
        row.resize(self.head.len(), String::new());
        self.rows.push(row);
    }

    /// Whether there is any row.
    pub(crate) const fn has_rows(&self) -> bool {
        !self.rows.is_empty()
    }

    /// The table in Markdown, an empty line behind it.
    pub(crate) fn markdown(&self) -> String {
        let mut text = markdown_row(&self.head);
        let rules = (0..self.head.len()).map(|column| if column == 0 { "---" } else { "---:" });
        text.push_str(&markdown_row(&rules.collect::<Vec<_>>()));
        for row in &self.rows {
            text.push_str(&markdown_row(row));
        }
        text.push('\n');
        text
    }

    /// The table as a LaTeX `table` with booktabs' rules.
    pub(crate) fn latex(&self, label: &str, caption: &str) -> String {
        let columns: String = std::iter::once('l')
            .chain(std::iter::repeat_n('r', self.head.len().saturating_sub(1)))
            .collect();
        let mut text = String::new();
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "\\begin{{table*}}[ht]\n\\caption{{{}}}\n\\label{{{label}}}\n\\centering\\footnotesize\n\
             \\begin{{tabular}}{{{columns}}}\n\\toprule",
            escape_latex(caption)
        );
        text.push_str(&self.latex_groups());
        text.push_str(&latex_row(&self.head));
        text.push_str("\\midrule\n");
        for row in &self.rows {
            text.push_str(&latex_row(row));
        }
        text.push_str("\\bottomrule\n\\end{tabular}\n\\end{table*}\n");
        text
    }

    fn latex_groups(&self) -> String {
        if self.groups.is_empty() {
            return String::new();
        }
        let titles: Vec<String> = self
            .groups
            .iter()
            .map(|(title, span)| format!("\\multicolumn{{{span}}}{{c}}{{{}}}", escape_latex(title)))
            .collect();
        let mut text = format!("{} \\\\\n", titles.join(" & "));
        let mut first = 1;
        for (title, span) in &self.groups {
            if !title.is_empty() {
                let _ = write!(text, "\\cmidrule(lr){{{first}-{}}}", first + span - 1);
            }
            first += span;
        }
        text.push('\n');
        text
    }
}

fn markdown_row<T: AsRef<str>>(cells: &[T]) -> String {
    let cells: Vec<String> = cells
        .iter()
        .map(|cell| escape_markdown(cell.as_ref()))
        .collect();
    format!("| {} |\n", cells.join(" | "))
}

fn latex_row(cells: &[String]) -> String {
    let cells: Vec<String> = cells.iter().map(|cell| escape_latex(cell)).collect();
    format!("{} \\\\\n", cells.join(" & "))
}

/// Text that stays one cell of a Markdown table, whatever a message put into it.
pub(crate) fn escape_markdown(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '|' | '<' | '*' | '`' | '[' | '\\' => escaped.extend(['\\', character]),
            control if control.is_control() => escaped.push(' '),
            plain => escaped.push(plain),
        }
    }
    escaped
}

/// Text that LaTeX prints as it is.
pub(crate) fn escape_latex(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => escaped.extend(['\\', character]),
            '~' => escaped.push_str("\\textasciitilde{}"),
            '^' => escaped.push_str("\\textasciicircum{}"),
            '\\' => escaped.push_str("\\textbackslash{}"),
            '<' => escaped.push_str("\\textless{}"),
            '>' => escaped.push_str("\\textgreater{}"),
            '–' => escaped.push_str("--"),
            '×' => escaped.push_str("$\\times$"),
            control if control.is_control() => escaped.push(' '),
            plain => escaped.push(plain),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latex_prints_what_messages_put_into_names() {
        assert_eq!(
            escape_latex("50% of a_b & c\\d {x} #1 $2 ~^ <\n>"),
            "50\\% of a\\_b \\& c\\textbackslash{}d \\{x\\} \\#1 \\$2 \\textasciitilde{}\
             \\textasciicircum{} \\textless{} \\textgreater{}"
        );
    }

    #[test]
    fn a_cell_cannot_break_out_of_a_markdown_table() {
        let mut grid = Grid::new(["a", "b"]);
        grid.row(["x|y\nz".to_owned(), "1".to_owned()]);
        assert_eq!(
            grid.markdown(),
            "| a | b |\n| --- | ---: |\n| x\\|y z | 1 |\n\n"
        );
    }

    #[test]
    fn groups_span_their_columns() {
        let mut grid = Grid::new(["n", "a", "b"]).grouped(&[("", 1), ("both", 2)]);
        grid.row(["1", "2", "3"].map(str::to_owned));
        let text = grid.latex("tab:x", "50 %");
        assert!(text.contains("\\caption{50 \\%}"), "{text}");
        assert!(text.contains(
            "\\multicolumn{1}{c}{} & \\multicolumn{2}{c}{both} \\\\\n\\cmidrule(lr){2-3}\n"
        ));
        assert!(text.contains("\\begin{tabular}{lrr}\n\\toprule"), "{text}");
        assert!(
            text.contains("n & a & b \\\\\n\\midrule\n1 & 2 & 3 \\\\\n\\bottomrule"),
            "{text}"
        );
    }

    #[test]
    fn rows_have_the_width_of_the_head() {
        let mut grid = Grid::new(["a", "b"]);
        grid.row(["1".to_owned()]);
        grid.row(["1", "2", "3"].map(str::to_owned));
        assert_eq!(grid.rows, [["1", ""], ["1", "2"]]);
    }
}
