//! Charts as values, and how they become SVG.

use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use crate::Error;
use crate::format::significant;
use crate::spread::Spread;

/// Width and height of a plot.
const SIZE_PX: (u32, u32) = (800, 480);
/// Most points of a series; of more, every nth is drawn.
const MAX_POINTS: usize = 4000;
/// Most series, boxes and names of a chart.
const MAX_SERIES: usize = 24;
/// Most points of a line that each get a dot.
const MAX_DOTS: usize = 100;
/// Part of an axis that is left free at either end.
const MARGIN: f64 = 0.05;
/// Half of a box's width; boxes stand one apart.
const HALF_BOX: f64 = 0.25;

/// Colours of series, told apart by most eyes; they begin anew after the last.
const COLOURS: [RGBColor; 8] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 96, 20),
    RGBColor(44, 140, 60),
    RGBColor(130, 80, 170),
    RGBColor(190, 30, 60),
    RGBColor(110, 90, 80),
    RGBColor(20, 150, 160),
    RGBColor(110, 110, 110),
];

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    /// Line, with a dot at each point unless there are many.
    Line,
    /// Thin dashed line, for what ours is compared with.
    ThinLine,
    /// Dots.
    Points,
}

/// Points with a name.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Series {
    pub(super) name: String,
    pub(super) mark: Mark,
    pub(super) points: Vec<(f64, f64)>,
}

/// A plot: series, or boxes by name, or bars (from, to, height).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chart {
    pub(super) file: &'static str,
    title: &'static str,
    labels: (&'static str, &'static str),
    is_log_y: bool,
    is_from_zero: bool,
    is_legend_above: bool,
    pub(super) series: Vec<Series>,
    pub(super) boxes: Vec<(String, Spread)>,
    pub(super) bars: Vec<(f64, f64, f64)>,
}

/// Smallest and largest value of an axis.
type Limits = (f64, f64);

impl Chart {
    pub(super) fn new(
        file: &'static str,
        title: &'static str,
        labels: (&'static str, &'static str),
    ) -> Self {
        Self {
            file,
            title,
            labels,
            is_log_y: false,
            is_from_zero: false,
            is_legend_above: false,
            series: Vec::new(),
            boxes: Vec::new(),
            bars: Vec::new(),
        }
    }

    /// Makes the y axis logarithmic. Values of 0 and less are left out.
    pub(super) fn log_y(mut self) -> Self {
        self.is_log_y = true;
        self
    }

    /// Shows the y axis from 0 on, however far from it the values are.
    pub(super) fn starting_at_zero(mut self) -> Self {
        self.is_from_zero = true;
        self
    }

    /// Puts the legend where falling curves leave room for it.
    pub(super) fn legend_above(mut self) -> Self {
        self.is_legend_above = true;
        self
    }

    pub(super) fn line(&mut self, name: &str, points: impl IntoIterator<Item = (f64, f64)>) {
        self.add(name, Mark::Line, points);
    }

    pub(super) fn thin_line(&mut self, name: &str, points: impl IntoIterator<Item = (f64, f64)>) {
        self.add(name, Mark::ThinLine, points);
    }

    fn add(&mut self, name: &str, mark: Mark, points: impl IntoIterator<Item = (f64, f64)>) {
        self.series.push(Series {
            name: name.to_owned(),
            mark,
            points: points
                .into_iter()
                .filter(|(x, y)| x.is_finite() && y.is_finite())
                .collect(),
        });
    }

    pub(super) fn has_data(&self) -> bool {
        self.limits().is_some()
    }

    /// Smallest and largest x of all points.
    pub(super) fn x_range(&self) -> Option<Limits> {
        limits_of(
            self.series
                .iter()
                .flat_map(|series| &series.points)
                .map(|point| point.0),
        )
    }

    fn is_shown(&self, y: f64) -> bool {
        y.is_finite() && (y > 0.0 || !self.is_log_y)
    }

    /// Limits of both axes, or `None` if there is nothing to draw.
    fn limits(&self) -> Option<(Limits, Limits)> {
        let points = self
            .series
            .iter()
            .flat_map(|series| series.points.iter().copied());
        let boxes = (0..).zip(&self.boxes).flat_map(|(index, (_, spread))| {
            let x = f64::from(index);
            [(x - 0.5, spread.least), (x + 0.5, spread.most)]
        });
        let bars = self
            .bars
            .iter()
            .flat_map(|bar| [(bar.0, 0.0), (bar.1, bar.2)]);
        let shown: Vec<(f64, f64)> = points
            .chain(boxes)
            .chain(bars)
            .filter(|(_, y)| self.is_shown(*y))
            .collect();
        let x = limits_of(shown.iter().map(|point| point.0))?;
        let y = limits_of(shown.iter().map(|point| point.1))?;
        if self.is_log_y {
            return Some((x, (y.0 / 1.3, y.1 * 1.3)));
        }
        // What grows from 0 is shown from there.
        let bottom = if y.0 >= 0.0 && (self.is_from_zero || y.0 < 0.5 * y.1) {
            0.0
        } else {
            y.0
        };
        let margin = ((y.1 - bottom) * MARGIN)
            .max(f64::EPSILON * y.1.abs())
            .max(1e-9);
        let below = if bottom == 0.0 { 0.0 } else { margin };
        Some((x, (bottom - below, y.1 + margin)))
    }

    /// Draws the chart into its file; nothing is drawn, and the answer is no, without data.
    ///
    /// # Errors
    /// [`Error::Plot`] if the file could not be written.
    pub(super) fn draw(&self, directory: &Path) -> Result<bool, Error> {
        let Some(limits) = self.limits() else {
            return Ok(false);
        };
        let path = directory.join(self.file);
        let area = SVGBackend::new(&path, SIZE_PX).into_drawing_area();
        let drawn = if self.is_log_y {
            let (low, high) = limits.1;
            self.draw_on(&area, limits.0, (low..high).log_scale())
        } else {
            let (low, high) = limits.1;
            self.draw_on(&area, limits.0, low..high)
        };
        drawn
            .and_then(|()| area.present())
            .map_err(|error| Error::Plot {
                plot: self.file.to_owned(),
                what: error.to_string(),
            })?;
        Ok(true)
    }

    fn draw_on<Y>(&self, area: &Area<'_>, (left, right): Limits, y_axis: Y) -> Drawn
    where
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        area.fill(&WHITE)?;
        let x_axis = if left < right {
            left..right
        } else {
            left - 0.5..right + 0.5
        };
        let mut context = ChartBuilder::on(area)
            .caption(self.title, ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(72)
            .build_cartesian_2d(x_axis, y_axis)?;
        let names = |x: &f64| {
            if self.boxes.is_empty() {
                significant(*x)
            } else {
                self.box_name(*x)
            }
        };
        let mut mesh = context.configure_mesh();
        mesh.x_desc(self.labels.0)
            .y_desc(self.labels.1)
            .light_line_style(WHITE)
            .x_label_formatter(&names)
            .y_label_formatter(&|y| significant(*y));
        if !self.boxes.is_empty() {
            mesh.disable_x_mesh().x_labels(2 * self.boxes.len() + 1);
        }
        mesh.draw()?;
        self.draw_boxes(&mut context)?;
        let bars = self.bars.iter().map(|(from, to, height)| {
            Rectangle::new([(*from, 0.0), (*to, *height)], colour(0).mix(0.7).filled())
        });
        context.draw_series(bars)?;
        self.draw_series(&mut context)
    }

    /// The name of the box at a place of the x axis.
    fn box_name(&self, x: f64) -> String {
        let near = (0..)
            .zip(&self.boxes)
            .find(|(index, _)| (x - f64::from(*index)).abs() < 1e-6);
        near.map_or_else(String::new, |(_, (name, _))| name.clone())
    }

    fn draw_boxes<Y>(&self, context: &mut Context<'_, Y>) -> Drawn
    where
        Y: Ranged<ValueType = f64>,
    {
        for (index, (name, spread)) in self.boxes.iter().enumerate().take(MAX_SERIES) {
            let x = index as f64;
            let (left, right) = (x - HALF_BOX, x + HALF_BOX);
            let shown = |y: f64| if self.is_shown(y) { y } else { spread.median };
            let (lower, upper) = (shown(spread.lower_quartile), spread.upper_quartile);
            let filled = [(left, lower), (right, upper)];
            // A method has one colour, however many boxes.
            let first = self.boxes.iter().position(|(other, _)| other == name);
            let colour = colour(first.unwrap_or(index));
            context.draw_series([Rectangle::new(filled, colour.mix(0.4).filled())])?;
            let middle = |y: f64| vec![(x - HALF_BOX / 2.0, y), (x + HALF_BOX / 2.0, y)];
            let least = shown(spread.least);
            let lines = [
                vec![(left, spread.median), (right, spread.median)],
                vec![(x, least), (x, lower)],
                vec![(x, upper), (x, spread.p99)],
                middle(least),
                middle(spread.p99),
            ];
            context.draw_series(lines.map(|line| PathElement::new(line, BLACK)))?;
        }
        Ok(())
    }

    fn draw_series<Y>(&self, context: &mut Context<'_, Y>) -> Drawn
    where
        Y: Ranged<ValueType = f64>,
    {
        let drawn = self
            .series
            .iter()
            .filter(|series| !series.points.is_empty());
        for (index, series) in drawn.clone().take(MAX_SERIES).enumerate() {
            let nth = series.points.len().div_ceil(MAX_POINTS);
            let points: Vec<(f64, f64)> = series
                .points
                .iter()
                .step_by(nth)
                .copied()
                .filter(|(_, y)| self.is_shown(*y))
                .collect();
            let colour = colour(index).to_rgba();
            if series.mark != Mark::Points {
                let is_thin = series.mark == Mark::ThinLine;
                let style = colour.stroke_width(if is_thin { 1 } else { 2 });
                let line = points.iter().copied();
                let drawn = if is_thin {
                    context.draw_series(DashedLineSeries::new(line, 6, 4, style))?
                } else {
                    context.draw_series(LineSeries::new(line, style))?
                };
                drawn
                    .label(series.name.as_str())
                    .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
            }
            let has_dots = series.mark == Mark::Line && points.len() <= MAX_DOTS;
            if has_dots || series.mark == Mark::Points {
                let dots = points
                    .iter()
                    .map(|point| Circle::new(*point, 2, colour.filled()));
                let dots = context.draw_series(dots)?;
                if series.mark == Mark::Points {
                    dots.label(series.name.as_str())
                        .legend(move |(x, y)| Circle::new((x + 9, y), 3, colour.filled()));
                }
            }
        }
        if drawn.count() > 0 {
            let mut labels = context.configure_series_labels();
            labels.position(if self.is_legend_above {
                SeriesLabelPosition::UpperRight
            } else {
                SeriesLabelPosition::LowerRight
            });
            labels
                .background_style(WHITE.mix(0.8))
                .border_style(BLACK.mix(0.3));
            labels.draw()?;
        }
        Ok(())
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Context<'a, Y> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, Y>>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

fn limits_of(values: impl Iterator<Item = f64>) -> Option<Limits> {
    values.fold(None, |limits, value| {
        let (least, most) = limits.unwrap_or((value, value));
        Some((least.min(value), most.max(value)))
    })
}
