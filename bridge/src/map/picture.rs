//! Pictures of maps, whichever format they have, as one shade a pixel.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use super::pgm::{MAX_FILE_BYTES, Pgm};
use super::read_limited;
use super::settings::Shade;
use crate::Error;
use crate::geometry::MAX_GRID_SIDE_CELLS;

const PNG_MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Most memory that the decoder may take besides the pixels.
const MAX_DECODER_BYTES: usize = 64 << 20;
/// Shades of 8 bits, without an opacity.
const LEVELS: usize = 256;

/// A picture of a map.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MapPicture {
    /// Pixels a row.
    pub(super) width: u32,
    /// Rows.
    pub(super) height: u32,
    samples: Samples,
}

/// Pixels, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
enum Samples {
    Grey(Vec<u8>),
    Png {
        bytes: Vec<u8>,
        /// Channels a pixel: 1 or 3 colours, with or without an opacity.
        channels: usize,
        is_wide: bool,
    },
}

impl MapPicture {
    /// Reads a PGM or a PNG file, told apart by its first bytes.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::BadFile`] name the file and what was expected.
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let io = |source| Error::Io {
            path: path.to_owned(),
            source,
        };
        let mut file = File::open(path).map_err(io)?;
        let mut magic = Vec::new();
        (&mut file).take(8).read_to_end(&mut magic).map_err(io)?;
        if magic == PNG_MAGIC {
            file.rewind().map_err(io)?;
            return Self::of_png(file, path);
        }
        let pgm = Pgm::parse(&read_limited(path, MAX_FILE_BYTES)?, path)?;
        Ok(Self {
            width: pgm.width,
            height: pgm.height,
            samples: Samples::Grey(pgm.pixels),
        })
    }

    fn of_png(file: File, path: &Path) -> Result<Self, Error> {
        let bad = |what: String| Error::BadFile {
            path: path.to_owned(),
            what,
        };
        let wrong = |error: png::DecodingError| bad(format!("not a readable PNG picture: {error}"));
        let limits = png::Limits {
            bytes: MAX_DECODER_BYTES,
        };
        let mut decoder = png::Decoder::new_with_limits(BufReader::new(file), limits);
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        // Palettes become colours, and fewer than 8 bits become 8.
        decoder.set_transformations(png::Transformations::EXPAND);
        let info = decoder.read_header_info().map_err(wrong)?;
        let (width, height) = (info.width, info.height);
        let sides = 1..=MAX_GRID_SIDE_CELLS;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(bad(format!(
                "{width} x {height} pixels, expected 1 to {MAX_GRID_SIDE_CELLS} a side"
            )));
        }
        let mut reader = decoder.read_info().map_err(wrong)?;
        let (colour, depth) = reader.output_color_type();
        let len = reader.output_buffer_size().unwrap_or_default();
        let mut bytes = vec![0; len];
        reader.next_frame(&mut bytes).map_err(wrong)?;
        Ok(Self {
            width,
            height,
            samples: Samples::Png {
                bytes,
                channels: colour.samples(),
                is_wide: depth == png::BitDepth::Sixteen,
            },
        })
    }

    /// What `of` says of each pixel, row by row from the top.
    pub(super) fn cells(&self, of: impl Fn(Shade) -> i8) -> Vec<i8> {
        match &self.samples {
            Samples::Grey(pixels) => {
                let known: [i8; LEVELS] = std::array::from_fn(|level| {
                    of(Shade {
                        brightness: level as f64 / 255.0,
                        opacity: None,
                    })
                });
                pixels
                    .iter()
                    .map(|&level| known[usize::from(level)])
                    .collect()
            }
            Samples::Png {
                bytes,
                channels,
                is_wide,
            } => {
                let bytes_a_sample = 1 + usize::from(*is_wide);
                bytes
                    .chunks_exact(channels * bytes_a_sample)
                    .map(|pixel| of(shade_of(pixel, bytes_a_sample)))
                    .collect()
            }
        }
    }
}

/// The shade of a pixel of 1 to 4 channels.
fn shade_of(pixel: &[u8], bytes_a_sample: usize) -> Shade {
    let channels = pixel.len() / bytes_a_sample;
    let sample = |index: usize| match pixel[index * bytes_a_sample..][..bytes_a_sample] {
        [high, low] => f64::from(u16::from_be_bytes([high, low])) / f64::from(u16::MAX),
        [byte] => f64::from(byte) / f64::from(u8::MAX),
        _ => 0.0,
    };
    let colours = if channels < 3 { 1 } else { 3 };
    let sum: f64 = (0..colours).map(sample).sum();
    Shade {
        brightness: sum / colours as f64,
        opacity: (channels > colours).then(|| sample(colours)),
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::map::MapYaml;

    /// Writes a PNG file of one row.
    fn png_of(folder: &Path, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> PathBuf {
        let path = folder.join("map.png");
        let pixels = data.len() * 8 / (colour.samples() * depth as usize);
        let file = File::create(&path).unwrap();
        let mut encoder = png::Encoder::new(file, u32::try_from(pixels).unwrap(), 1);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if colour == png::ColorType::Indexed {
            encoder.set_palette([0, 0, 0, 255, 255, 255, 255, 255, 255, 205, 205, 205].to_vec());
            encoder.set_trns([255, 255, 0, 255].to_vec());
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(data).unwrap();
        writer.finish().unwrap();
        path
    }

    fn trinary(path: &Path) -> Vec<i8> {
        let yaml = MapYaml::default();
        let picture = MapPicture::read(path).unwrap();
        picture.cells(|shade| yaml.occupancy_of(shade))
    }

    #[test]
    fn every_kind_of_png_becomes_what_map_server_makes_of_it() {
        use png::BitDepth::{Eight, One, Sixteen, Two};
        use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
        let folder = tempfile::tempdir().unwrap();
        let of = |colour, depth, data: &[u8]| trinary(&png_of(folder.path(), colour, depth, data));
        assert_eq!(of(Grayscale, Eight, &[0, 205, 254]), [100, -1, 0]);
        assert_eq!(
            of(Grayscale, One, &[0b1010_0000]),
            [0, 100, 0, 100, 100, 100, 100, 100]
        );
        assert_eq!(
            of(Grayscale, Sixteen, &[0, 0, 205, 205, 255, 0]),
            [100, -1, 0]
        );
        // A mean of 205 and 85.
        assert_eq!(of(Rgb, Eight, &[255, 255, 105, 0, 255, 0]), [-1, 100]);
        assert_eq!(of(Rgb, Sixteen, &[255, 255, 255, 255, 105, 105]), [-1]);
        // Black, white, white that is transparent, grey; a palette with opacities has four channels,
        // so that the last, with a mean of 217.5, is free.
        assert_eq!(of(Indexed, Two, &[0b0001_1011]), [100, 0, -1, 0]);
        assert_eq!(
            of(GrayscaleAlpha, Eight, &[255, 255, 255, 0, 0, 255]),
            [0, -1, 100]
        );
        assert_eq!(
            of(Rgba, Eight, &[0, 0, 0, 255, 255, 255, 255, 0]),
            [100, -1]
        );
    }

    #[test]
    fn damaged_and_giant_png_files_are_refused_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = png_of(
            folder.path(),
            png::ColorType::Grayscale,
            png::BitDepth::Eight,
            &[7; 300],
        );
        let good = std::fs::read(&path).unwrap();
        for cut in [8, 20, 40, good.len() - 20] {
            std::fs::write(&path, &good[..cut]).unwrap();
            let error = MapPicture::read(&path).unwrap_err().to_string();
            assert!(
                error.contains("map.png: not a readable PNG"),
                "{cut}: {error}"
            );
        }
        let file = File::create(&path).unwrap();
        let encoder = png::Encoder::new(file, 5000, 1);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[0; 5000]).unwrap();
        drop(writer);
        let error = MapPicture::read(&path).unwrap_err().to_string();
        assert!(
            error.contains("5000 x 1 pixels, expected 1 to 4096"),
            "{error}"
        );
    }
}
