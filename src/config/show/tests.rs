use super::*;

/// Paths of all values of a tree that are no sections.
fn leaves(tree: &Value, path: &str, found: &mut Vec<String>) {
    match tree {
        Value::Table(table) => {
            for (name, value) in table {
                let path = match path {
                    "" => name.clone(),
                    section => format!("{section}.{name}"),
                };
                leaves(value, &path, found);
            }
        }
        _ => found.push(path.to_owned()),
    }
}

fn parsed(text: &str) -> Config {
    toml::from_str(text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[test]
fn what_is_printed_reads_back_as_the_defaults() {
    let text = toml_of(&Config::default()).unwrap();
    assert_eq!(parsed(&text), Config::default(), "{text}");
}

#[test]
fn every_key_of_the_configuration_has_a_line_in_the_table_of_keys() {
    let defaults = keys::tree_of(&Config::default()).unwrap();
    let mut found = Vec::new();
    leaves(&defaults, "", &mut found);
    for path in found {
        let is_known = keys::all().any(|key| key.path == path);
        assert!(is_known, "{path} has no line in src/config/keys.txt");
    }
}

#[test]
fn every_line_of_the_table_of_keys_is_a_key_with_a_range_and_a_sentence() {
    let defaults = keys::tree_of(&Config::default()).unwrap();
    let mut paths = std::collections::BTreeSet::new();
    for key in keys::all() {
        assert!(paths.insert(key.path), "{} stands twice", key.path);
        assert!(key.says.ends_with('.'), "{}: {:?}", key.path, key.says);
        match keys::value_at(&defaults, key.path) {
            Some(value) if value.is_table() => assert_eq!(key.range, "", "{}", key.path),
            Some(_) => {
                assert_ne!(key.range, "", "{}", key.path);
                assert_eq!(key.example, None, "{} has a default", key.path);
            }
            None => {
                let example = key.example.unwrap_or_else(|| {
                    panic!(
                        "{} is no key of the configuration, or lacks an example",
                        key.path
                    )
                });
                let text = format!("[{}]\n{} = {example}\n", key.section(), key.name());
                assert_ne!(parsed(&text), Config::default(), "{}", key.path);
            }
        }
    }
}

#[test]
fn units_are_those_of_the_names() {
    let units = [
        ("_m_per_s", "m/s"),
        ("_per_m2", "1/m²"),
        ("_per_m", "1/m"),
        ("_m", "m"),
        ("_rad", "rad"),
        ("_s", "s"),
        ("_ms", "ms"),
        ("_percent", "%"),
        ("_cells", "cells"),
    ];
    for key in keys::all() {
        let of_name = units
            .iter()
            .find(|(suffix, _)| key.name().ends_with(suffix));
        if let Some((_, unit)) = of_name {
            assert_eq!(key.unit, *unit, "{}", key.path);
        }
    }
}

/// The configuration with one number, or both numbers of a span, set.
fn with(key: &Key, number: f64) -> Result<Config, toml::de::Error> {
    let mut tree = keys::tree_of(&Config::default()).unwrap();
    let section = key.section().split('.').fold(&mut tree, |tree, name| {
        tree.get_mut(name).expect("the section is there")
    });
    let value = match section.get(key.name()) {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "integers have small ranges"
        )]
        Some(Value::Integer(_)) => Value::Integer(number as i64),
        Some(Value::Array(_)) => Value::Array(vec![Value::Float(number), Value::Float(number)]),
        _ => Value::Float(number),
    };
    let section = section.as_table_mut().expect("sections are tables");
    section.insert(key.name().to_owned(), value);
    toml::from_str(&toml::to_string(&tree).unwrap())
}

#[test]
fn numbers_out_of_their_range_are_refused_by_name() {
    for key in keys::all() {
        let Some(range) = key.numbers() else {
            continue;
        };
        let below = if range.above {
            range.least
        } else {
            range.least - 1.0
        };
        for outside in [below, range.most + 1.0] {
            if !outside.is_finite() {
                continue;
            }
            // A type may refuse what is out of range before the table does.
            let Ok(config) = with(&key, outside) else {
                continue;
            };
            let error = keys::check(&config).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{} is ", key.path)), "{error}");
            assert!(error.contains(key.range), "{error}");
        }
    }
}

/// What the crates say of their sections.
fn by_crates(config: &Config) -> anyhow::Result<()> {
    config.vehicle.validate()?;
    config.grid.validate()?;
    config.follow.validate()?;
    config.train.validate()?;
    config.ingest().validate()?;
    config.generator().validate()?;
    Ok(())
}

#[test]
fn what_the_table_allows_the_crates_take() {
    // Limits of these depend on other keys.
    let coupled = [
        "vehicle.min_turning_radius_m",
        "targets.nearest_m",
        "targets.farthest_m",
        "ingest.min_height_m",
        "ingest.max_height_m",
        "train.batch",
        "train.micro_batch",
    ];
    for key in keys::all() {
        let Some(range) = key.numbers().filter(|_| !coupled.contains(&key.path)) else {
            continue;
        };
        if matches!(key.section(), "grid") {
            continue;
        }
        let least = if range.above {
            range.least + 1e-3
        } else {
            range.least
        };
        for inside in [least, range.most] {
            if !inside.is_finite() {
                continue;
            }
            let config = with(&key, inside).unwrap_or_else(|error| panic!("{}: {error}", key.path));
            keys::check(&config).unwrap_or_else(|error| panic!("{}: {error:#}", key.path));
            let checked = by_crates(&config);
            checked.unwrap_or_else(|error| panic!("{}: {error:#}", key.path));
        }
    }
}

#[test]
fn changed_values_are_shown_beside_their_defaults() {
    let mut config = Config::default();
    config.plan.epsilon = 1.5;
    let text = toml_of(&config).unwrap();
    assert!(text.contains("epsilon = 1.5 # default: 1.2\n"), "{text}");
    assert_eq!(parsed(&text), config);
}

#[test]
fn any_value_stays_on_one_line_and_reads_back() {
    for text in [
        "rows = [{ speed_km_per_h = 5.0, curvature_per_m = 0.2 }, { speed_km_per_h = 9.0 }]",
        "names = [\"a\", \"it's\"]",
        "single = 0.10000000149011612",
        "deep = [[1, 2], [3.5, -4.0]]",
    ] {
        let value: Value = toml::from_str(text).unwrap();
        for (name, value) in value.as_table().unwrap() {
            let line = format!("{name} = {}", inline(value));
            assert!(!line.contains('\n'), "{line}");
            for text in [line, format!("{name} = {}", lines_of(value))] {
                let again: Value = toml::from_str(&text).unwrap();
                if name != "single" {
                    assert_eq!(again.get(name), Some(value), "{text}");
                }
            }
        }
    }
    assert_eq!(inline(&Value::Float(f64::from(0.1_f32))), "0.1");
    assert_eq!(inline(&Value::Float(2.5e-3)), "0.0025");
}

#[test]
fn lines_are_short_enough_to_read() {
    let text = toml_of(&Config::default()).unwrap();
    for line in text.lines() {
        assert!(line.chars().count() <= COMMENT_COLUMNS + 20, "{line}");
    }
}

#[test]
fn the_page_in_docs_is_the_one_that_the_command_prints() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/configuration.md");
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == page().unwrap(),
        "docs/configuration.md is out of date: swath config --markdown > docs/configuration.md"
    );
}
