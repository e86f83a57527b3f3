//! Reports of recordings whose numbers were worked out by hand.

#![expect(
    clippy::unwrap_used,
    reason = "a test's own input holds, or the test fails"
)]

mod recordings;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use recordings::{after_ms, bench, plan, run, sample, write};
use swath_analysis::{Error, ReportOptions, Summary, report};
use swath_bridge::msg::swath::{PlanReport, Rejection};
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::{Outcome, keys};

fn report_of(recordings: &[PathBuf], out_dir: &Path) -> Result<Summary, Error> {
    report(recordings, out_dir, &ReportOptions::default(), |_| {})
}

/// A report of a benchmark and a live run.
fn report_of_both(directory: &Path) -> Summary {
    let recordings = [
        write(directory, "bench.mcap", bench),
        write(directory, "run.mcap", run),
    ];
    report_of(&recordings, &directory.join("out")).unwrap()
}

/// Rows of a CSV table by column; none of the tests' values has a comma.
fn table(directory: &Path, name: &str) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(directory.join(format!("out/tables/{name}.csv"))).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned));
    let head: Vec<String> = lines.next().unwrap().collect();
    lines
        .map(|line| head.iter().cloned().zip(line).collect())
        .collect()
}

/// The numbers in some columns of the rows that match; empty cells are NaN.
fn numbers<const N: usize>(
    rows: &[BTreeMap<String, String>],
    matching: &[(&str, &str)],
    columns: [&str; N],
) -> Vec<[f64; N]> {
    rows.iter()
        .filter(|row| {
            matching
                .iter()
                .all(|(column, value)| row[*column] == *value)
        })
        .map(|row| columns.map(|column| row[column].parse().unwrap_or(f64::NAN)))
        .collect()
}

#[track_caller]
fn assert_near<const N: usize>(found: &[[f64; N]], expected: &[[f64; N]]) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
    }
}

#[test]
fn one_target_is_compared_on_pairs_alone() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let rows = table(directory.path(), "comparisons");
    let times = ["pairs", "search_ms_q1", "search_ms_median", "search_ms_q3"];
    let chosen = |set, method| {
        numbers(
            &rows,
            &[("targets", "1"), ("pairs_with", set), ("method", method)],
            times,
        )
    };
    assert_near(&chosen("all", "tiev"), &[[4.0, 17.5, 25.0, 32.5]]);
    assert_near(&chosen("all", "tiev-fcn"), &[[4.0, 4.75, 10.0, 36.25]]);
    assert_near(&chosen("solved", "tiev"), &[[3.0, 15.0, 20.0, 25.0]]);
    assert_near(&chosen("solved", "tiev-fcn"), &[[3.0, 4.5, 5.0, 10.0]]);
}

#[test]
fn ratios_are_of_medians_and_of_pairs() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let rows = table(directory.path(), "ratios");
    let columns = [
        "of_medians",
        "of_pairs_q1",
        "of_pairs_median",
        "of_pairs_q3",
        "of_pairs_most",
    ];
    let chosen = |set, measure| {
        numbers(
            &rows,
            &[("targets", "1"), ("pairs_with", set), ("measure", measure)],
            columns,
        )
    };
    // Pair by pair 5/10, 4/20, 15/30 and 100/40; the fourth target was not reached.
    assert_near(&chosen("all", "search_ms"), &[[0.4, 0.425, 0.5, 1.0, 2.5]]);
    assert_near(
        &chosen("solved", "search_ms"),
        &[[0.25, 0.35, 0.5, 0.5, 0.5]],
    );
    assert_near(&chosen("solved", "cpu_ms"), &[[0.25, 0.35, 0.5, 0.5, 0.5]]);
    // 50/100, 100/200 and 60/300.
    assert_near(&chosen("solved", "steps"), &[[0.3, 0.35, 0.5, 0.5, 0.5]]);
}

#[test]
fn targets_are_compared_where_both_methods_reached_them() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let three = [("targets", "3"), ("pairs_with", "all")];
    let rows = table(directory.path(), "reached");
    let columns = ["all", "by_both", "by_baseline_alone", "by_compared_alone"];
    assert_near(&numbers(&rows, &three, columns), &[[3.0, 2.0, 0.0, 1.0]]);
    let rows = table(directory.path(), "comparisons");
    assert_near(
        &numbers(
            &rows,
            &three,
            ["solved_mean", "search_ms_median", "network_ms_median"],
        ),
        &[[2.0, 60.0, 0.0], [3.0, 30.0, 2.0]],
    );
    let rows = table(directory.path(), "ratios");
    let cost = [
        three[0],
        three[1],
        ("measure", "cost of targets that both reached"),
    ];
    assert_near(&numbers(&rows, &cost, ["of_pairs_median"]), &[[1.2]]);
}

#[test]
fn many_other_numbers_of_targets_are_left_to_the_files() {
    let directory = tempfile::tempdir().unwrap();
    let file = write(directory.path(), "odd.mcap", |writer| {
        for count in 0..=30u8 {
            let solved = |_| recordings::target(count, Outcome::Solved, (1.0, 1, 1.0));
            for method in ["tiev", "tiev-fcn"] {
                let targets = (0..count).map(solved).collect();
                let report = plan(u64::from(count), method, 1.0, targets);
                let nanos = report.header.stamp.nanos();
                writer
                    .write(&keys::plan("bench"), &report, nanos, nanos)
                    .unwrap();
            }
        }
    });
    report_of(&[file], &directory.path().join("out")).unwrap();
    let text = fs::read_to_string(directory.path().join("out/report.md")).unwrap();
    // Of 1 to 30 the paper has seven; plans to no target are no comparison at all.
    assert!(
        text.contains("23 frames with 23 other numbers of targets"),
        "{text}"
    );
    assert!(
        text.contains("| 30 | 1 |") && !text.contains("| 29 | 1 |"),
        "{text}"
    );
    let chosen = [("pairs_with", "all"), ("method", "tiev")];
    let rows = numbers(
        &table(directory.path(), "comparisons"),
        &chosen,
        ["targets"],
    );
    let expected: Vec<[f64; 1]> = (1..=30u8).map(|count| [f64::from(count)]).collect();
    assert_near(&rows, &expected);
}

/// How CSV writes the group of a whole evaluation.
const NO_GROUP: &str = "\"\"";

#[test]
fn evaluations_of_the_same_add_up_once() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let rows = table(directory.path(), "agreement");
    let columns = [
        "weights_version",
        "samples",
        "iou_path",
        "iou_background",
        "miou",
    ];
    let of = |predictor, group| {
        numbers(
            &rows,
            &[("predictor", predictor), ("group", group)],
            columns,
        )
    };
    let chosen = |predictor| of(predictor, NO_GROUP);
    assert_near(
        &of("enet", "distance/10-20 m"),
        &[[2.0, 10.0, 0.8, 0.9, 0.85]],
    );
    assert_near(
        &chosen("enet"),
        &[[1.0, 10.0, 0.1, 0.9, 0.5], [2.0, 20.0, 0.8, 0.9, 0.85]],
    );
    assert_near(
        &chosen("dilated reference"),
        &[[0.0, 10.0, 0.25, 0.5, 0.375]],
    );
    let marks: Vec<(&str, &str)> = rows
        .iter()
        .filter(|row| row["group"] == NO_GROUP)
        .map(|row| (row["is_baseline"].as_str(), row["is_newest"].as_str()))
        .collect();
    assert_eq!(
        marks,
        [("true", "true"), ("false", "false"), ("false", "true")]
    );
}

#[test]
fn the_papers_miou_stands_beside_enough_samples_only() {
    for (samples, is_shown) in [(199, false), (200, true)] {
        let directory = tempfile::tempdir().unwrap();
        let file = write(directory.path(), "run.mcap", |writer| {
            let mut message = recordings::evaluation("enet", 1, [80, 100, 90, 100]);
            message.samples = samples;
            writer
                .write(&keys::evaluation("r1"), &message, 1, 1)
                .unwrap();
        });
        let summary = report_of(&[file], &directory.path().join("out")).unwrap();
        let text = fs::read_to_string(directory.path().join("out/report.md")).unwrap();
        assert_eq!(text.contains("| paper |"), is_shown, "{text}");
        assert_eq!(text.contains("too uncertain to compare"), !is_shown);
        let said = summary.lines().join("\n");
        assert_eq!(said.contains("the paper: mIoU 90.19 %"), is_shown, "{said}");
        assert_eq!(said.contains("too few, it takes 200"), !is_shown, "{said}");
    }
}

#[test]
fn samples_are_counted_with_their_gaps_and_rates() {
    let directory = tempfile::tempdir().unwrap();
    let summary = report_of_both(directory.path());
    let rows = table(directory.path(), "generators");
    let columns = ["received", "missing", "duplicates", "rate_per_s"];
    // 19 later samples of g0 within 2 s, 10 of g1 within 2 s, 30 of both within 2 s.
    assert_near(
        &numbers(&rows, &[], columns),
        &[[20.0, 2.0, 1.0, 9.5], [11.0, 0.0, 0.0, 5.0]],
    );
    assert!((summary.samples_per_s.unwrap() - 15.0).abs() < 1e-9);
    assert_eq!((summary.samples, summary.samples_missing), (31, 2));
}

#[test]
fn weights_are_followed_from_the_trainer_into_plans() {
    let directory = tempfile::tempdir().unwrap();
    let summary = report_of_both(directory.path());
    let rows = table(directory.path(), "weights_health");
    let columns = [
        "published",
        "applied",
        "newest_published",
        "newest_applied",
        "plans",
    ];
    assert_near(&numbers(&rows, &[], columns), &[[3.0, 2.0, 3.0, 2.0, 8.0]]);
    // Ages are 2, 3, ..., 9 s.
    assert_near(
        &numbers(&rows, &[], ["age_s_median", "age_s_p99"]),
        &[[5.5, 8.93]],
    );
    assert_eq!((summary.weights_published, summary.weights_applied), (3, 2));
}

#[test]
fn plans_of_live_grids_have_their_latency_and_those_of_benchmarks_none() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let rows = table(directory.path(), "planners");
    let of = |vehicle| {
        let columns = ["plans", "skipped", "with_network"];
        numbers(&rows, &[("vehicle", vehicle)], columns)
    };
    assert_near(&of("v0"), &[[10.0, 5.0, 8.0]]);
    assert_near(&of("bench"), &[[13.0, 0.0, 0.0]]);
    // Latencies are 10, 11, ..., 19 ms.
    let latency = ["latency_ms_median", "latency_ms_p99", "latency_ms_most"];
    assert_near(
        &numbers(&rows, &[("vehicle", "v0")], latency),
        &[[14.5, 18.91, 19.0]],
    );
    let of_bench = numbers(&rows, &[("vehicle", "bench")], ["latency_ms_most"]);
    assert!(of_bench[0][0].is_nan());
}

#[test]
fn outcomes_are_counted_by_method() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let counted: Vec<String> = table(directory.path(), "outcomes")
        .iter()
        .map(|row| format!("{} {} {}", row["method"], row["outcome"], row["targets"]))
        .collect();
    assert_eq!(
        counted,
        [
            "tiev budget_exhausted 1",
            "tiev solved 9",
            "tiev unreachable 1",
            "tiev-fcn goal_occupied 1",
            "tiev-fcn solved 14",
            "tiev-fcn unreachable 1",
        ]
    );
}

#[test]
fn the_report_reads_as_it_did() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let text = fs::read_to_string(directory.path().join("out/report.md")).unwrap();
    insta::assert_snapshot!("report", text);
    let text = fs::read_to_string(directory.path().join("out/tables.tex")).unwrap();
    insta::assert_snapshot!("tables", text);
}

#[test]
fn the_same_recordings_give_the_same_files() {
    let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let summary = report_of_both(first.path());
    report_of_both(second.path());
    assert!(summary.written.len() > 30);
    for path in &summary.written {
        let file = path.strip_prefix(first.path()).unwrap();
        let other = fs::read(second.path().join(file)).unwrap();
        assert!(fs::read(path).unwrap() == other, "{}", file.display());
    }
}

#[test]
fn every_plot_that_the_report_shows_is_there_and_is_svg() {
    let directory = tempfile::tempdir().unwrap();
    report_of_both(directory.path());
    let out_dir = directory.path().join("out");
    let text = fs::read_to_string(out_dir.join("report.md")).unwrap();
    let shown: Vec<&str> = text
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
        .collect();
    assert_eq!(shown.len(), 10, "{shown:?}");
    for plot in shown {
        let svg = fs::read_to_string(out_dir.join(plot)).unwrap();
        assert!(
            svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"),
            "{plot}"
        );
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{plot}");
    }
}

#[test]
fn sections_without_data_say_so() {
    let directory = tempfile::tempdir().unwrap();
    let file = write(directory.path(), "samples.mcap", |writer| {
        for number in 0..5 {
            let message = sample("g0", number);
            let log = message.header.stamp.nanos();
            writer
                .write(&keys::sample("g0"), &message, log, log)
                .unwrap();
        }
    });
    report_of(&[file], &directory.path().join("out")).unwrap();
    let text = fs::read_to_string(directory.path().join("out/report.md")).unwrap();
    for said in [
        "No frame was planned to one target by two methods",
        "No plans were recorded",
        "No frame was planned by two methods",
        "No evaluation was recorded",
        "there is no rate",
        "No trainer told its status",
        "No weights were published",
        "No grids and no plans were recorded",
        "No target was planned to",
    ] {
        assert!(text.contains(said), "{said}");
    }
    assert!(!text.contains("!["), "no plot without data");
}

#[test]
fn names_from_messages_cannot_break_the_tables() {
    let directory = tempfile::tempdir().unwrap();
    let file = write(directory.path(), "names.mcap", |writer| {
        let mut message = recordings::evaluation("enet|<b>_%&", 1, [1, 2, 3, 4]);
        message.split = "a\nb".to_owned();
        writer
            .write(&keys::evaluation("r"), &message, 1, 1)
            .unwrap();
    });
    report_of(&[file], &directory.path().join("out")).unwrap();
    let markdown = fs::read_to_string(directory.path().join("out/report.md")).unwrap();
    assert!(
        markdown.contains("| enet\\|\\<b>_%& | r1 | 1 | a b |"),
        "{markdown}"
    );
    let latex = fs::read_to_string(directory.path().join("out/tables.tex")).unwrap();
    assert!(
        latex.contains("enet|\\textless{}b\\textgreater{}\\_\\%\\& & r1"),
        "{latex}"
    );
}

#[test]
fn a_recording_of_something_else_says_what_it_holds() {
    let directory = tempfile::tempdir().unwrap();
    let other = write(directory.path(), "other.mcap", |writer| {
        let message = TFMessage {
            transforms: Vec::new(),
        };
        writer
            .write_as("/tf_static", &message, after_ms(0), after_ms(0))
            .unwrap();
    });
    let good = write(directory.path(), "run.mcap", run);
    let error = report_of(&[good, other], &directory.path().join("out")).unwrap_err();
    assert!(
        matches!(error, Error::NoSwathTopics { messages: 1, .. }),
        "{error:?}"
    );
    let text = error.to_string();
    assert!(text.contains("other.mcap") && text.contains("/tf_static (tf2_msgs/msg/TFMessage)"));
    let empty = write(directory.path(), "empty.mcap", |_| {});
    let error = report_of(&[empty], &directory.path().join("out")).unwrap_err();
    assert!(error.to_string().contains("found nothing"), "{error}");
}

#[test]
fn files_that_are_no_recordings_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let out_dir = directory.path().join("out");
    assert!(matches!(report_of(&[], &out_dir), Err(Error::NoRecordings)));
    let missing = directory.path().join("missing.mcap");
    let error = report_of(&[missing], &out_dir).unwrap_err().to_string();
    assert!(error.contains("missing.mcap"), "{error}");
    let text = directory.path().join("text.mcap");
    fs::write(&text, "not a recording").unwrap();
    let error = report_of(&[text], &out_dir).unwrap_err().to_string();
    assert!(error.contains("text.mcap"), "{error}");
    let whole = write(directory.path(), "run.mcap", run);
    let bytes = fs::read(&whole).unwrap();
    for len in [0, 5, bytes.len() / 2, bytes.len() - 1] {
        fs::write(&whole, &bytes[..len]).unwrap();
        let error = report_of(std::slice::from_ref(&whole), &out_dir).unwrap_err();
        assert!(matches!(error, Error::Recording(_)), "{len}: {error}");
    }
    assert!(
        !out_dir.exists(),
        "nothing is written before everything was read"
    );
}

#[test]
fn tables_have_a_limit() {
    let directory = tempfile::tempdir().unwrap();
    let file = write(directory.path(), "run.mcap", run);
    let options = ReportOptions {
        max_rows: 30,
        ..ReportOptions::default()
    };
    let error = report(&[file], &directory.path().join("out"), &options, |_| {}).unwrap_err();
    assert!(
        matches!(
            error,
            Error::TooManyRows {
                table: "samples",
                limit: 30
            }
        ),
        "{error:?}"
    );
}

#[test]
fn progress_ends_at_the_end() {
    let directory = tempfile::tempdir().unwrap();
    let files = [
        write(directory.path(), "bench.mcap", bench),
        write(directory.path(), "run.mcap", run),
    ];
    let mut seen = Vec::new();
    report(
        &files,
        &directory.path().join("out"),
        &ReportOptions::default(),
        |progress| {
            seen.push((progress.read_bytes, progress.total_bytes, progress.messages));
        },
    )
    .unwrap();
    let (read_bytes, total_bytes, messages) = *seen.last().unwrap();
    assert_eq!(read_bytes, total_bytes);
    assert_eq!(messages, 13 + 31 + 3 + 3 + 5 + 3 + 10 + 1);
    assert!(seen.is_sorted());
}

fn rejection(topic: &str, cause: &str, messages: u64) -> Rejection {
    Rejection {
        topic: topic.to_owned(),
        cause: cause.to_owned(),
        messages,
    }
}

#[test]
fn empty_paths_and_rejected_messages_are_counted_by_reason_and_cause() {
    let directory = tempfile::tempdir().unwrap();
    let file = write(directory.path(), "stops.mcap", |writer| {
        let mut say = |frame: u64, reason: &str, detail: &str, rejected: Vec<Rejection>| {
            let planned = frame > 0;
            let report = PlanReport {
                vehicle: "v0".to_owned(),
                method: if planned { "swath" } else { "" }.to_owned(),
                latency_ms: if planned { 5.0 } else { f32::NAN },
                reason: reason.to_owned(),
                detail: detail.to_owned(),
                rejected,
                ..plan(frame, "swath", 3.0, Vec::new())
            };
            let log = after_ms(frame * 100);
            writer.write(&keys::plan("v0"), &report, log, log).unwrap();
        };
        say(0, "no grid yet", "", vec![]);
        say(
            1,
            "blocked",
            "first",
            vec![rejection("odom", "no car moves so", 4)],
        );
        say(
            0,
            "no transform",
            "from \"map\"",
            vec![rejection("odom", "no car moves so", 6)],
        );
        say(
            2,
            "blocked",
            "second",
            vec![rejection("odom", "no car moves so", 7)],
        );
        say(3, "", "", vec![rejection("odom", "no car moves so", 7)]);
        // The planner was started anew and counts from the beginning.
        let anew = vec![
            rejection("grid", "it does not decode", 2),
            rejection("odom", "no car moves so", 1),
        ];
        say(1, "", "", anew);
    });
    report_of(&[file], &directory.path().join("out")).unwrap();
    let planners = table(directory.path(), "planners");
    assert_eq!(planners[0]["plans"], "4", "{planners:?}");
    assert_eq!(table(directory.path(), "stops").len(), 4);
    let rejections: Vec<[String; 3]> = table(directory.path(), "rejections")
        .into_iter()
        .map(|row| ["topic", "cause", "messages"].map(|column| row[column].clone()))
        .collect();
    assert_eq!(
        rejections,
        [
            ["grid", "it does not decode", "2"],
            ["odom", "no car moves so", "8"]
        ]
    );
    let text = fs::read_to_string(directory.path().join("out/report.md")).unwrap();
    let rows = [
        ["v0", "blocked", "2", "second"],
        ["v0", "no grid yet", "1", ""],
        ["v0", "no transform", "1", "from \"map\""],
        ["v0", "odom", "no car moves so", "8"],
    ];
    for row in rows {
        assert!(has_row(&text, &row), "{row:?}\n{text}");
    }
}

/// Whether a table of a text has a row of these cells.
fn has_row(text: &str, row: &[&str]) -> bool {
    text.lines().any(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        cells == row
    })
}
