//! Maps as ROS `map_server` writes them: a PGM picture and, beside it, a YAML file of its size and
//! place.
//!
//! With a YAML file a picture has x to the right and y up, as ROS has it. A picture alone has the
//! vehicle heading up, is of the size of the grid that the reader asks for, and takes the default
//! thresholds.

mod image;
mod yaml;

use std::path::{Path, PathBuf};

pub use image::{MAX_FILE_BYTES, Pgm};
pub use yaml::{MapYaml, Mode};

use crate::Error;
use crate::geometry::GridSpec;
use crate::occupancy::{OCCUPIED_THRESHOLD, Occupancy, Source, UNKNOWN};

/// Grey value of an unknown cell in the maps that ROS writes.
const UNKNOWN_GREY: u8 = 205;
/// Grey value of a free cell in the maps that ROS writes.
const FREE_GREY: u8 = 254;
/// Most bytes that a YAML file may have.
const MAX_YAML_BYTES: u64 = 64 * 1024;

/// Reads a map: a `.yaml` file with the picture it names, or a picture with the YAML file of the
/// same name if there is one, or a picture alone, which has to be of the size of `spec`.
///
/// With a YAML file the grid has the map's own size and resolution, and the map's origin is the
/// vehicle's.
///
/// # Errors
/// [`Error::Io`] and [`Error::BadFile`] name the file and what was expected at which byte or line.
pub fn read_map(path: &Path, spec: &GridSpec) -> Result<Occupancy, Error> {
    let is_yaml = path
        .extension()
        .is_some_and(|extension| extension == "yaml" || extension == "yml");
    let yaml_path = if is_yaml {
        path.to_owned()
    } else {
        path.with_extension("yaml")
    };
    if !is_yaml && !yaml_path.is_file() {
        let pgm = Pgm::parse(&read_limited(path, MAX_FILE_BYTES)?, path)?;
        return upright(&pgm, spec, path);
    }
    let text = read_limited(&yaml_path, MAX_YAML_BYTES)?;
    let yaml = MapYaml::parse(&String::from_utf8_lossy(&text), &yaml_path)?;
    let image_path = if is_yaml {
        beside(&yaml_path, &yaml.image)
    } else {
        path.to_owned()
    };
    let pgm = Pgm::parse(&read_limited(&image_path, MAX_FILE_BYTES)?, &image_path)?;
    placed(&pgm, &yaml, &yaml_path)
}

/// Writes a map as ROS does: `path` with x to the right, and the YAML file of the same name.
///
/// # Errors
/// [`Error::Io`] names the file that could not be written.
pub fn write_map(path: &Path, occupancy: &Occupancy) -> Result<(), Error> {
    let spec = &occupancy.spec;
    let (rows, cols) = (spec.rows as usize, spec.cols as usize);
    // Picture rows run from the greatest y down, which is the grid's column 0, and along them x
    // grows, which is from the grid's last row to its first.
    let mut pixels = Vec::with_capacity(spec.len());
    for col in 0..cols {
        pixels.extend(
            (0..rows)
                .rev()
                .map(|row| grey_of(occupancy.cells[row * cols + col])),
        );
    }
    let pgm = Pgm {
        width: spec.rows,
        height: spec.cols,
        pixels,
    };
    let corner_m =
        |ego: u32, cells: u32| (f64::from(ego) - f64::from(cells) + 0.5) * spec.resolution_m;
    let yaml = MapYaml {
        image: path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default(),
        resolution_m: spec.resolution_m,
        origin: [
            corner_m(spec.ego_row, spec.rows),
            corner_m(spec.ego_col, spec.cols),
            0.0,
        ],
        ..MapYaml::default()
    };
    write(path, &pgm.to_bytes())?;
    write(&path.with_extension("yaml"), yaml.to_string().as_bytes())
}

/// A picture with the vehicle heading up.
fn upright(pgm: &Pgm, spec: &GridSpec, path: &Path) -> Result<Occupancy, Error> {
    spec.validate()?;
    if (pgm.width, pgm.height) != (spec.cols, spec.rows) {
        return Err(Error::BadFile {
            path: path.to_owned(),
            what: format!(
                "{} x {} pixels, expected {} x {} (columns x rows of the grid), or a YAML file \
                 of the same name with resolution and origin",
                pgm.width, pgm.height, spec.cols, spec.rows
            ),
        });
    }
    let thresholds = MapYaml::default();
    Ok(Occupancy {
        spec: *spec,
        cells: pgm
            .pixels
            .iter()
            .map(|grey| thresholds.occupancy_of(*grey))
            .collect(),
    })
}

/// A picture where its YAML file puts it.
fn placed(pgm: &Pgm, yaml: &MapYaml, yaml_path: &Path) -> Result<Occupancy, Error> {
    let cells: Vec<i8> = pgm
        .pixels
        .chunks_exact(pgm.width as usize)
        .rev()
        .flatten()
        .map(|grey| yaml.occupancy_of(*grey))
        .collect();
    let source = Source {
        cells: &cells,
        width: pgm.width,
        height: pgm.height,
        resolution_m: yaml.resolution_m,
        origin_m: (yaml.origin[0], yaml.origin[1]),
    };
    let spec = source.own_spec().map_err(|error| Error::BadFile {
        path: yaml_path.to_owned(),
        what: error.to_string(),
    })?;
    Ok(source.resampled(&spec))
}

fn grey_of(value: i8) -> u8 {
    match value {
        UNKNOWN => UNKNOWN_GREY,
        value if value >= OCCUPIED_THRESHOLD => 0,
        _ => FREE_GREY,
    }
}

/// A path that a file names, relative to that file.
fn beside(file: &Path, named: &str) -> PathBuf {
    file.parent().unwrap_or_else(|| Path::new("")).join(named)
}

/// Reads a whole file that may not be larger than `most_bytes`.
pub(crate) fn read_limited(path: &Path, most_bytes: u64) -> Result<Vec<u8>, Error> {
    use std::io::Read;
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(io)?;
    file.take(most_bytes + 1)
        .read_to_end(&mut bytes)
        .map_err(io)?;
    if bytes.len() as u64 > most_bytes {
        return Err(Error::BadFile {
            path: path.to_owned(),
            what: format!("more than {most_bytes} bytes, expected at most that"),
        });
    }
    Ok(bytes)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    std::fs::write(path, bytes).map_err(|source| Error::Io {
        path: path.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Cell;
    use crate::occupancy::{FREE, OCCUPIED};

    fn sketch() -> Occupancy {
        let spec = GridSpec {
            rows: 30,
            cols: 20,
            resolution_m: 0.5,
            ego_row: 22,
            ego_col: 9,
        };
        let mut occupancy = Occupancy::filled(spec, FREE);
        occupancy.set(Cell::new(0, 0), OCCUPIED);
        occupancy.set(Cell::new(3, 17), OCCUPIED);
        occupancy.set(Cell::new(29, 19), UNKNOWN);
        occupancy
    }

    #[test]
    fn a_written_map_is_read_back_by_either_of_its_files() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("map.pgm");
        write_map(&path, &sketch()).unwrap();
        assert_eq!(read_map(&path, &GridSpec::default()).unwrap(), sketch());
        assert_eq!(
            read_map(&path.with_extension("yaml"), &GridSpec::default()).unwrap(),
            sketch()
        );
    }

    #[test]
    fn a_picture_alone_has_the_vehicle_heading_up() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("map.pgm");
        let spec = GridSpec {
            rows: 2,
            cols: 3,
            resolution_m: 0.2,
            ego_row: 1,
            ego_col: 1,
        };
        std::fs::write(&path, b"P5 3 2 255\n\x00\xfe\xff\xfe\xfe\xcd").unwrap();
        let occupancy = read_map(&path, &spec).unwrap();
        assert_eq!(occupancy.cells, [OCCUPIED, FREE, FREE, FREE, FREE, UNKNOWN]);
        let error = read_map(&path, &GridSpec::default())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("3 x 2 pixels, expected 151 x 401"),
            "{error}"
        );
    }

    #[test]
    fn a_map_whose_origin_is_elsewhere_says_so() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("map.yaml");
        std::fs::write(directory.path().join("m.pgm"), b"P2 1 1 255 0").unwrap();
        std::fs::write(
            &path,
            "image: m.pgm\nresolution: 0.1\norigin: [5.0, 0.0, 0.0]\n",
        )
        .unwrap();
        let error = read_map(&path, &GridSpec::default())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("map.yaml") && error.contains("off the grid"),
            "{error}"
        );
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = read_map(Path::new("nowhere/none.pgm"), &GridSpec::default()).unwrap_err();
        assert!(error.to_string().contains("none.pgm"));
    }
}
