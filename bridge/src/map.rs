//! Maps as ROS `map_server` writes them: a picture (PGM or PNG) and, beside it, a YAML file of its size
//! and place.
//!
//! With a YAML file a picture has x to the right and y up, turned as the file says. A picture alone has
//! the vehicle heading up, is of the size of the grid that the reader asks for, and takes the default
//! thresholds.

mod document;
mod pgm;
mod picture;
mod settings;

use std::path::{Path, PathBuf};

pub use pgm::{MAX_FILE_BYTES, Pgm};
pub use settings::{MapYaml, Mode, Shade};

use crate::Error;
use crate::geometry::{GridSpec, Pose2};
use crate::occupancy::{OCCUPIED_THRESHOLD, Occupancy, Source, UNKNOWN};

use picture::MapPicture;

/// Grey value of an unknown cell in the maps that ROS writes.
const UNKNOWN_GREY: u8 = 205;
/// Grey value of a free cell in the maps that ROS writes.
const FREE_GREY: u8 = 254;
/// Most bytes that a YAML file may have.
const MAX_YAML_BYTES: u64 = 64 * 1024;
/// Most that a map may be turned to count as not turned, radians.
const MAX_TURN_RAD: f64 = 1e-4;

/// A map of a file, in the frame that its YAML file gives it. A picture alone has its frame at the
/// vehicle's cell of the configured grid, with x up.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    path: PathBuf,
    cells: Cells,
}

/// The cells, as the files have them.
#[derive(Debug, Clone, PartialEq)]
enum Cells {
    /// A picture alone.
    Upright(Occupancy),
    /// With a YAML file; the cells along x first, from the lower left corner.
    Placed {
        cells: Vec<i8>,
        width: u32,
        height: u32,
        resolution_m: f64,
        map_from_corner: Pose2,
    },
}

/// Where the top of a map's picture points in the frame of its cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Top {
    /// Along x, as a vehicle is drawn.
    X,
    /// Along y, as ROS draws maps.
    Y,
}

/// A map's own cells, not resampled, around a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Around {
    /// The cells. The origin of their frame is the centre of the cell under the pose.
    pub occupancy: Occupancy,
    /// That frame in the map's.
    pub map_from_grid: Pose2,
    /// The pose in the frame of the cells.
    pub pose: Pose2,
    /// Where the picture's top points in that frame.
    pub top: Top,
}

impl Map {
    /// Reads a map: a `.yaml` file with the picture that it names, or a picture with the YAML file of
    /// the same name if there is one, or a picture alone, which has to be of the size of `spec`.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::BadFile`] name the file and what was expected at which byte or line.
    pub fn read(path: &Path, spec: &GridSpec) -> Result<Self, Error> {
        let is_yaml = is_yaml(path);
        let yaml_path = if is_yaml {
            Some(path.to_owned())
        } else {
            let beside = ["yaml", "yml"].map(|extension| path.with_extension(extension));
            beside.into_iter().find(|beside| beside.is_file())
        };
        let Some(yaml_path) = yaml_path else {
            let picture = MapPicture::read(path)?;
            return Ok(Self {
                path: path.to_owned(),
                cells: Cells::Upright(upright(&picture, spec, path)?),
            });
        };
        let text = text_of(&read_limited(&yaml_path, MAX_YAML_BYTES)?, &yaml_path)?;
        let yaml = MapYaml::parse(&text, &yaml_path)?;
        let named = yaml_path
            .parent()
            .unwrap_or_else(|| Path::new(""))
            .join(&yaml.image);
        let image_path = if is_yaml { &named } else { path };
        if named.file_name() != image_path.file_name() {
            tracing::warn!(
                "{} names {}; its size and place are used for {}",
                yaml_path.display(),
                yaml.image,
                path.display()
            );
        }
        let picture = MapPicture::read(image_path)?;
        let cells = picture.cells(|shade| yaml.occupancy_of(shade));
        let rows = cells.chunks_exact(picture.width as usize);
        Ok(Self {
            cells: Cells::Placed {
                cells: rows.rev().flatten().copied().collect(),
                width: picture.width,
                height: picture.height,
                resolution_m: yaml.resolution_m,
                map_from_corner: yaml.origin,
            },
            path: yaml_path,
        })
    }

    /// Whether the cells lie along the axes of the map's frame.
    pub fn is_unturned(&self) -> bool {
        match &self.cells {
            Cells::Upright(_) => true,
            Cells::Placed {
                map_from_corner, ..
            } => map_from_corner.yaw_rad.abs() < MAX_TURN_RAD,
        }
    }

    /// The map for a vehicle that stands at the origin of its frame, heading along x.
    ///
    /// The cells are the map's own where that origin is the centre of one, else each is as occupied as
    /// the most occupied of the cells that it overlaps.
    ///
    /// # Errors
    /// [`Error::BadFile`] where the map is turned or its frame's origin is not on it.
    pub fn at_origin(&self) -> Result<Occupancy, Error> {
        let (cells, width, height, resolution_m, corner) = match &self.cells {
            Cells::Upright(occupancy) => return Ok(occupancy.clone()),
            Cells::Placed {
                cells,
                width,
                height,
                resolution_m,
                map_from_corner,
            } => (cells, *width, *height, *resolution_m, map_from_corner),
        };
        if !self.is_unturned() {
            return Err(
                self.bad("the map is turned, expected an origin with a yaw of 0".to_owned())
            );
        }
        let source = Source {
            cells,
            width,
            height,
            resolution_m,
            origin_m: (corner.x_m, corner.y_m),
        };
        let spec = source.own_spec().map_err(|error| {
            let what = format!("{error}; a start on the map is needed");
            self.bad(what)
        })?;
        Ok(source.resampled(&spec))
    }

    /// The map's own cells around a pose in its frame.
    ///
    /// # Errors
    /// [`Error::BadFile`] names the map and what it covers where the pose is not on it.
    pub fn around(&self, pose: &Pose2) -> Result<Around, Error> {
        let (spec, map_from_grid, top) = self.placed();
        let in_grid = map_from_grid.inverse().then(pose);
        let cell = spec.cell_at(in_grid.x_m, in_grid.y_m);
        let (Some(_), Ok(ego_row), Ok(ego_col)) = (
            spec.index_of(cell),
            u32::try_from(cell.row),
            u32::try_from(cell.col),
        ) else {
            return Err(self.off_the_map(pose));
        };
        let (x_m, y_m) = spec.centre_of(cell);
        let map_from_grid = map_from_grid.then(&Pose2::new(x_m, y_m, 0.0));
        let spec = GridSpec {
            ego_row,
            ego_col,
            ..spec
        };
        let cells = match &self.cells {
            Cells::Upright(occupancy) => occupancy.cells.clone(),
            Cells::Placed { cells, height, .. } => along_rows(cells, *height),
        };
        Ok(Around {
            occupancy: Occupancy { spec, cells },
            map_from_grid,
            pose: map_from_grid.inverse().then(pose),
            top,
        })
    }

    /// A grid of the map's cells, its frame in the map's, and where its top points.
    fn placed(&self) -> (GridSpec, Pose2, Top) {
        match &self.cells {
            Cells::Upright(occupancy) => (occupancy.spec, Pose2::default(), Top::X),
            Cells::Placed {
                width,
                height,
                resolution_m,
                map_from_corner,
                ..
            } => {
                let spec = GridSpec {
                    rows: *width,
                    cols: *height,
                    resolution_m: *resolution_m,
                    ego_row: width - 1,
                    ego_col: height - 1,
                };
                let half_m = resolution_m / 2.0;
                let centre = map_from_corner.then(&Pose2::new(half_m, half_m, 0.0));
                (spec, centre, Top::Y)
            }
        }
    }

    fn off_the_map(&self, pose: &Pose2) -> Error {
        let (spec, map_from_grid, _) = self.placed();
        let half_m = spec.resolution_m / 2.0;
        let (front_m, left_m) = spec.centre_of(spec.cell_of_index(0));
        let (rear_m, right_m) = spec.centre_of(spec.cell_of_index(spec.len() - 1));
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for x_m in [front_m + half_m, rear_m - half_m] {
            for y_m in [left_m + half_m, right_m - half_m] {
                let corner = map_from_grid.then(&Pose2::new(x_m, y_m, 0.0));
                for (axis, value) in [corner.x_m, corner.y_m].into_iter().enumerate() {
                    least[axis] = least[axis].min(value);
                    most[axis] = most[axis].max(value);
                }
            }
        }
        self.bad(format!(
            "the start ({}, {}) is off the map, expected x from {:.2} to {:.2} m and y from {:.2} to \
             {:.2} m",
            pose.x_m, pose.y_m, least[0], most[0], least[1], most[1]
        ))
    }

    fn bad(&self, what: String) -> Error {
        Error::BadFile {
            path: self.path.clone(),
            what,
        }
    }
}

/// [`Map::read`] and [`Map::at_origin`].
///
/// # Errors
/// Theirs.
pub fn read_map(path: &Path, spec: &GridSpec) -> Result<Occupancy, Error> {
    Map::read(path, spec)?.at_origin()
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
        origin: Pose2::new(
            corner_m(spec.ego_row, spec.rows),
            corner_m(spec.ego_col, spec.cols),
            0.0,
        ),
        ..MapYaml::default()
    };
    write(path, &pgm.to_bytes())?;
    write(&path.with_extension("yaml"), yaml.to_string().as_bytes())
}

/// A picture with the vehicle heading up.
fn upright(picture: &MapPicture, spec: &GridSpec, path: &Path) -> Result<Occupancy, Error> {
    spec.validate()?;
    if (picture.width, picture.height) != (spec.cols, spec.rows) {
        return Err(Error::BadFile {
            path: path.to_owned(),
            what: format!(
                "{} x {} pixels, expected {} x {} (columns x rows of the grid), or a YAML file \
                 of the same name with resolution and origin",
                picture.width, picture.height, spec.cols, spec.rows
            ),
        });
    }
    let thresholds = MapYaml::default();
    Ok(Occupancy {
        spec: *spec,
        cells: picture.cells(|shade| thresholds.occupancy_of(shade)),
    })
}

/// Cells along x first from the lower left corner, as rows from the greatest x down with the greatest y
/// first.
fn along_rows(cells: &[i8], height: u32) -> Vec<i8> {
    let height = height as usize;
    let width = cells.len() / height;
    let mut rows = Vec::with_capacity(cells.len());
    for x in (0..width).rev() {
        rows.extend((0..height).rev().map(|y| cells[y * width + x]));
    }
    rows
}

fn is_yaml(path: &Path) -> bool {
    path.extension().is_some_and(|extension| {
        extension.eq_ignore_ascii_case("yaml") || extension.eq_ignore_ascii_case("yml")
    })
}

/// The text of a YAML file: UTF-8, or UTF-16 with a byte-order mark.
fn text_of(bytes: &[u8], path: &Path) -> Result<String, Error> {
    let bad = |what: String| Error::BadFile {
        path: path.to_owned(),
        what,
    };
    let units = |of_pair: fn([u8; 2]) -> u16| {
        let pairs = bytes[2..].chunks_exact(2);
        let units: Vec<u16> = pairs.map(|pair| of_pair([pair[0], pair[1]])).collect();
        String::from_utf16(&units)
            .map_err(|_not_text| bad("not UTF-16 text, as it begins like".to_owned()))
    };
    match bytes {
        [0xff, 0xfe, ..] => units(u16::from_le_bytes),
        [0xfe, 0xff, ..] => units(u16::from_be_bytes),
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => Ok(text.to_owned()),
            Err(error) => Err(bad(format!("byte {}: not UTF-8 text", error.valid_up_to()))),
        },
    }
}

fn grey_of(value: i8) -> u8 {
    match value {
        UNKNOWN => UNKNOWN_GREY,
        value if value >= OCCUPIED_THRESHOLD => 0,
        _ => FREE_GREY,
    }
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
mod tests;
