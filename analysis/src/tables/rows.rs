//! Rows that become a frame, batch by batch.

use polars::prelude::DataFrame;

use crate::Error;
use crate::error::InTable as _;

/// Rows that are gathered before they go into the columns.
const BATCH_ROWS: usize = 8192;

/// A row of a table whose columns are the fields.
pub(crate) trait Row: Sized {
    /// Name of the table, and of its files.
    const TABLE: &'static str;

    /// The rows as columns.
    ///
    /// # Errors
    /// As polars says.
    fn columns(rows: &[Self]) -> polars::error::PolarsResult<DataFrame>;
}

/// Declares a struct and makes it a [`Row`]: a column a field, in their order.
macro_rules! row_table {
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $name:ident in $table:literal {
            $( $(#[$field_attribute:meta])* $field:ident: $kind:ty, )*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, PartialEq)]
        $visibility struct $name {
            $( $(#[$field_attribute])* pub(crate) $field: $kind, )*
        }

        impl $crate::tables::Row for $name {
            const TABLE: &'static str = $table;

            fn columns(
                rows: &[Self],
            ) -> polars::error::PolarsResult<polars::prelude::DataFrame> {
                use polars::prelude::NamedFrom as _;
                polars::prelude::DataFrame::new(rows.len(), vec![$(
                    polars::prelude::Column::from(polars::prelude::Series::new(
                        stringify!($field).into(),
                        rows.iter().map(|row| row.$field.clone()).collect::<Vec<$kind>>(),
                    )),
                )*])
            }
        }
    };
}

pub(crate) use row_table;

/// A table that grows up to a limit.
#[derive(Debug)]
pub(crate) struct Rows<R> {
    batch: Vec<R>,
    frame: Option<DataFrame>,
    len: usize,
    limit: usize,
}

impl<R: Row> Rows<R> {
    pub(crate) fn new(limit: usize) -> Self {
        Self {
            batch: Vec::new(),
            frame: None,
            len: 0,
            limit,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// # Errors
    /// [`Error::TooManyRows`] when the table is full, [`Error::Table`] if polars refuses a column.
    pub(crate) fn push(&mut self, row: R) -> Result<(), Error> {
        if self.len >= self.limit {
            return Err(Error::TooManyRows {
                table: R::TABLE,
                limit: self.limit,
            });
        }
        self.len += 1;
        self.batch.push(row);
        if self.batch.len() >= BATCH_ROWS {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Error> {
        let frame = R::columns(&self.batch).in_table(R::TABLE)?;
        self.batch.clear();
        match &mut self.frame {
            Some(whole) => {
                whole.vstack_mut_owned(frame).in_table(R::TABLE)?;
            }
            none => *none = Some(frame),
        }
        Ok(())
    }

    /// The frame of all rows; without any it still has its columns.
    ///
    /// # Errors
    /// [`Error::Table`] if polars refuses a column.
    pub(crate) fn finish(mut self) -> Result<DataFrame, Error> {
        self.flush()?;
        let mut frame = self.frame.unwrap_or_default();
        frame.rechunk_mut();
        Ok(frame)
    }
}

/// A number where there is one: NaN is how messages say that there is none.
pub(super) fn number(value: impl Into<f64>) -> Option<f64> {
    Some(value.into()).filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    row_table! {
        /// A row.
        pub(crate) struct Pair in "pairs" {
            name: String,
            value: Option<f64>,
        }
    }

    fn pair(value: f64) -> Pair {
        Pair {
            name: value.to_string(),
            value: number(value),
        }
    }

    #[test]
    fn batches_join_in_their_order() {
        let mut rows = Rows::new(usize::MAX);
        let count = 2 * BATCH_ROWS + 3;
        for index in 0..count {
            rows.push(pair(index as f64)).unwrap();
        }
        let frame = rows.finish().unwrap();
        assert_eq!(frame.shape(), (count, 2));
        let values = frame.column("value").unwrap().f64().unwrap();
        assert!((0..count).all(|index| values.get(index) == Some(index as f64)));
    }

    #[test]
    fn no_rows_are_a_frame_with_columns() {
        let frame = Rows::<Pair>::new(1).finish().unwrap();
        assert_eq!(frame.shape(), (0, 2));
    }

    #[test]
    fn a_full_table_says_which_and_how_much() {
        let mut rows = Rows::new(2);
        rows.push(pair(1.0)).unwrap();
        rows.push(pair(f64::NAN)).unwrap();
        let error = rows.push(pair(3.0)).unwrap_err().to_string();
        assert!(error.contains("pairs") && error.contains('2'), "{error}");
    }
}
