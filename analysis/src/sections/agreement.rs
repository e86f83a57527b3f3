//! How well regions match labels, the paper's figure beside ours.

use super::Section;
use crate::agreement::Agreement;
use crate::format::{count, interval, optional, percent};
use crate::grid::Grid;
use crate::interval::{Interval, MIN_COMPARED_SAMPLES};
use crate::paper;

/// The section, from every agreement.
pub(crate) fn section(agreements: &[Agreement], drawn: &[String]) -> Section {
    let mut section = Section::titled("Regions against labels");
    if agreements.is_empty() {
        section.paragraph("No evaluation was recorded, so there is no mIoU to show.");
    } else {
        section.paragraph(
            "Intersection over union of the path's cells, of all other cells, and their mean, from \
             counts added up over all samples. The interval holds the mIoU over many more samples of \
             the same kind with a probability of 95 % (Wilson's interval, which is wide for a mean of \
             shares). Of each run's weights the newest version that was \
             evaluated is shown; the others are in `tables/agreement.csv`. Predictors marked as \
             baselines learned nothing.",
        );
        section.labelled_table(
            "tab:miou".to_owned(),
            "Agreement of regions with labels.".to_owned(),
            table(agreements),
        );
        if !newest(agreements).any(Agreement::is_comparable) {
            section.paragraph(&format!(
                "The paper's mIoU is not shown beside these: no learned predictor was evaluated on \
                 {MIN_COMPARED_SAMPLES} samples or more, and over fewer the mIoU is too uncertain to \
                 compare."
            ));
        }
        let groups = groups(agreements);
        if groups.has_rows() {
            section.heading("By kind of scene and distance of the target");
            section.labelled_table(
                "tab:groups".to_owned(),
                "Agreement of learned regions with labels, by group.".to_owned(),
                groups,
            );
        }
    }
    section.plot(drawn, "miou_by_distance.svg", "mIoU by distance");
    section.plot(drawn, "loss.svg", "Training loss");
    section.plot(drawn, "miou.svg", "mIoU over training");
    section
}

fn table(agreements: &[Agreement]) -> Grid {
    let mut grid = Grid::new([
        "predictor",
        "run",
        "version",
        "split",
        "dilation (m)",
        "samples",
        "mIoU",
        "95 % interval",
        "IoU path",
        "IoU background",
        "joined",
        "ms per sample",
    ]);
    let of_all = |agreement: &&Agreement| agreement.subject.group.is_empty();
    for agreement in newest(agreements).filter(of_all) {
        let (subject, sums) = (&agreement.subject, &agreement.sums);
        let (mark, version) = if subject.is_learned() {
            ("", subject.weights_version.to_string())
        } else {
            (" (baseline)", String::new())
        };
        grid.row([
            format!("{}{mark}", subject.predictor),
            subject.run.clone(),
            version,
            subject.split.clone(),
            format!("{:.2}", subject.dilation_mm as f64 / 1000.0),
            count(sums.samples),
            percent(sums.miou()),
            interval(sums.miou_interval()),
            percent(sums.iou_path()),
            percent(sums.iou_background()),
            percent(sums.joined_share()),
            optional(sums.ms_per_sample()),
        ]);
    }
    if newest(agreements).any(Agreement::is_comparable) {
        let empty = std::iter::repeat_n(String::new(), 4);
        let paper = [
            count(paper::TEST_SAMPLES),
            percent(Some(paper::MIOU)),
            interval(Interval::of_mean(paper::MIOU, paper::TEST_SAMPLES)),
        ];
        grid.row(["paper".to_owned()].into_iter().chain(empty).chain(paper));
    }
    grid
}

fn newest(agreements: &[Agreement]) -> impl Iterator<Item = &Agreement> {
    agreements.iter().filter(|agreement| agreement.is_newest)
}

/// The parts of what learned predictors were evaluated on.
fn groups(agreements: &[Agreement]) -> Grid {
    let mut grid = Grid::new([
        "predictor",
        "split",
        "dilation (m)",
        "group",
        "samples",
        "mIoU",
        "IoU path",
        "joined",
    ]);
    for Agreement { subject, sums, .. } in newest(agreements) {
        if subject.is_learned() && !subject.group.is_empty() {
            grid.row([
                subject.predictor.clone(),
                subject.split.clone(),
                format!("{:.2}", subject.dilation_mm as f64 / 1000.0),
                subject.group.clone(),
                count(sums.samples),
                percent(sums.miou()),
                percent(sums.iou_path()),
                percent(sums.joined_share()),
            ]);
        }
    }
    grid
}
