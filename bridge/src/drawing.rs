//! Drawings of lines, discs and text over an image, written as PNG or as SVG.
//!
//! Places are pixels from the upper left, x to the right and y down. A drawing looks the same on every
//! machine as PNG; as SVG its text is of the viewer's monospaced font, at the same places.

mod raster;
mod svg;

use std::path::Path;

use crate::Error;
use crate::picture::Colour;

/// Most pixels along a side.
pub const MAX_DRAWING_PX: u32 = 8192;
/// Side of a letter that is written without enlarging it, pixels.
pub const GLYPH_PX: u32 = 8;

/// A place in a drawing, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spot {
    /// To the right.
    pub x: f64,
    /// Down.
    pub y: f64,
}

impl Spot {
    /// The place (`x`, `y`).
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite()
    }
}

/// The format of a picture's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureFormat {
    /// Pixels.
    Png,
    /// Lines and text, with the map as an image.
    Svg,
}

impl PictureFormat {
    /// Names of those that can be written.
    pub const KNOWN: &'static str = ".png or .svg";

    /// The format that a file's name asks for.
    pub fn of_path(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        match extension.as_str() {
            "png" => Some(Self::Png),
            "svg" => Some(Self::Svg),
            _ => None,
        }
    }
}

/// Pixels row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels a row.
    pub width: u32,
    /// All of them.
    pub pixels: Vec<Colour>,
}

impl Image {
    /// Rows.
    pub fn height(&self) -> u32 {
        let rows = self.pixels.len() / (self.width as usize).max(1);
        u32::try_from(rows).unwrap_or(u32::MAX)
    }
}

/// Text and how it is written.
#[derive(Debug, Clone, PartialEq)]
pub struct Text {
    /// One line.
    pub text: String,
    /// Upper left of its first letter.
    pub at: Spot,
    /// How many times [`GLYPH_PX`] a letter is wide and high.
    pub scale: u32,
    /// Colour of the letters.
    pub colour: Colour,
    /// Colour around the letters, to be read on any ground.
    pub halo: Option<Colour>,
}

impl Text {
    /// Width of a line of text, pixels.
    pub fn width_px(text: &str, scale: u32) -> f64 {
        text.chars().count() as f64 * f64::from(GLYPH_PX * scale)
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Item {
    Image {
        image: Image,
        at: (u32, u32),
        scale: u32,
    },
    Line {
        spots: Vec<Spot>,
        colour: Colour,
        width_px: f64,
    },
    Disc {
        centre: Spot,
        radius_px: f64,
        colour: Colour,
    },
    Rectangle {
        from: Spot,
        to: Spot,
        colour: Colour,
    },
    Text(Text),
}

/// What is drawn, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    width_px: u32,
    height_px: u32,
    ground: Colour,
    items: Vec<Item>,
}

impl Drawing {
    /// An empty drawing; each side has 1 to [`MAX_DRAWING_PX`] pixels.
    pub fn new(width_px: u32, height_px: u32, ground: Colour) -> Self {
        Self {
            width_px: width_px.clamp(1, MAX_DRAWING_PX),
            height_px: height_px.clamp(1, MAX_DRAWING_PX),
            ground,
            items: Vec::new(),
        }
    }

    /// Width and height, pixels.
    pub const fn size_px(&self) -> (u32, u32) {
        (self.width_px, self.height_px)
    }

    /// Lays an image with its upper left at a pixel, each of its pixels `scale` a side.
    pub fn image(&mut self, image: Image, at: (u32, u32), scale: u32) {
        self.items.push(Item::Image { image, at, scale });
    }

    /// Draws a line through spots.
    pub fn line(&mut self, spots: Vec<Spot>, colour: Colour, width_px: f64) {
        if spots.len() > 1 && spots.iter().all(|spot| spot.is_finite()) {
            self.items.push(Item::Line {
                spots,
                colour,
                width_px,
            });
        }
    }

    /// Fills a disc.
    pub fn disc(&mut self, centre: Spot, radius_px: f64, colour: Colour) {
        if centre.is_finite() {
            self.items.push(Item::Disc {
                centre,
                radius_px,
                colour,
            });
        }
    }

    /// Fills a rectangle between its upper left and its lower right.
    pub fn rectangle(&mut self, from: Spot, to: Spot, colour: Colour) {
        if from.is_finite() && to.is_finite() {
            self.items.push(Item::Rectangle { from, to, colour });
        }
    }

    /// Writes a line of text.
    pub fn text(&mut self, text: Text) {
        if text.at.is_finite() {
            self.items.push(Item::Text(text));
        }
    }

    /// The drawing as a file of a format.
    ///
    /// # Errors
    /// [`Error::Io`], of no path, if it cannot be encoded.
    pub fn to_bytes(&self, format: PictureFormat) -> Result<Vec<u8>, Error> {
        match format {
            PictureFormat::Png => png_of(self.width_px, self.height_px, &raster::pixels_of(self)),
            PictureFormat::Svg => svg::text_of(self).map(String::into_bytes),
        }
    }

    /// Writes the drawing in the format that the file's name asks for.
    ///
    /// # Errors
    /// [`Error::BadFile`] names the formats where the name asks for none of them, [`Error::Io`] the
    /// file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let format = PictureFormat::of_path(path).ok_or_else(|| Error::BadFile {
            path: path.to_owned(),
            what: format!("not a name of a picture, expected {}", PictureFormat::KNOWN),
        })?;
        let bytes = self.to_bytes(format)?;
        std::fs::write(path, bytes).map_err(|source| Error::Io {
            path: path.to_owned(),
            source,
        })
    }
}

/// Pixels as a PNG file, the same bytes for the same pixels.
///
/// # Errors
/// [`Error::Io`], of no path, if they cannot be encoded.
pub(crate) fn png_of(width_px: u32, height_px: u32, pixels: &[Colour]) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width_px, height_px);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder
        .write_header()
        .and_then(|mut writer| {
            writer.write_image_data(pixels.as_flattened())?;
            writer.finish()
        })
        .map_err(|error| Error::Io {
            path: "picture".into(),
            source: std::io::Error::other(error),
        })?;
    Ok(bytes)
}

/// The dots of a letter, x to the right and y down; none of a letter without a glyph.
pub(crate) fn dots_of(character: char) -> impl Iterator<Item = (i64, i64)> {
    use font8x8::UnicodeFonts;
    let glyph = font8x8::BASIC_FONTS.get(character);
    let glyph = glyph.or_else(|| font8x8::LATIN_FONTS.get(character));
    (0..).zip(glyph.unwrap_or_default()).flat_map(|(y, row)| {
        (0..i64::from(GLYPH_PX))
            .filter(move |x| row & (1 << x) != 0)
            .map(move |x| (x, y))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{BLACK, RED, WHITE};

    fn decoded(bytes: &[u8]) -> (u32, u32, Vec<u8>) {
        let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width, info.height, pixels)
    }

    fn pixel(drawing: &Drawing, x: usize, y: usize) -> Colour {
        let (width, _, pixels) = decoded(&drawing.to_bytes(PictureFormat::Png).unwrap());
        let at = 3 * (y * width as usize + x);
        [pixels[at], pixels[at + 1], pixels[at + 2]]
    }

    fn sketch() -> Drawing {
        let mut drawing = Drawing::new(60, 40, WHITE);
        let image = Image {
            width: 2,
            pixels: vec![BLACK, RED, RED, BLACK],
        };
        drawing.image(image, (4, 2), 5);
        drawing.line(vec![Spot::new(30.0, 20.0), Spot::new(50.0, 20.0)], RED, 4.0);
        drawing.disc(Spot::new(40.0, 8.0), 5.0, BLACK);
        drawing.rectangle(Spot::new(0.0, 30.0), Spot::new(3.0, 33.0), BLACK);
        drawing.text(Text {
            text: "a<b&\u{1}".to_owned(),
            at: Spot::new(20.0, 28.0),
            scale: 1,
            colour: BLACK,
            halo: None,
        });
        drawing
    }

    #[test]
    fn what_is_drawn_is_where_it_was_drawn() {
        let drawing = sketch();
        assert_eq!(pixel(&drawing, 6, 4), BLACK);
        assert_eq!(pixel(&drawing, 11, 4), RED);
        assert_eq!(pixel(&drawing, 11, 10), BLACK);
        assert_eq!(pixel(&drawing, 40, 20), RED);
        assert_eq!(pixel(&drawing, 40, 25), WHITE);
        assert_eq!(pixel(&drawing, 40, 8), BLACK);
        assert_eq!(pixel(&drawing, 1, 31), BLACK);
        let letter = (20..28).flat_map(|x| (28..36).map(move |y| (x, y)));
        let dark = letter
            .filter(|&(x, y)| pixel(&drawing, x, y) == BLACK)
            .count();
        assert!((8..40).contains(&dark), "{dark} dots of an a");
    }

    #[test]
    fn an_svg_holds_the_same_things_and_escapes_text() {
        let text = String::from_utf8(sketch().to_bytes(PictureFormat::Svg).unwrap()).unwrap();
        assert!(text.starts_with("<svg ") && text.trim_end().ends_with("</svg>"));
        for part in [
            "<image ",
            "<polyline ",
            "<circle ",
            "<rect ",
            ">a&lt;b&amp;\u{fffd}</text>",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
        let encoded = text
            .split("base64,")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap();
        // A PNG file begins with these bytes.
        assert!(encoded.starts_with("iVBORw0KGgo") && encoded.len().is_multiple_of(4));
    }

    #[test]
    fn nothing_far_away_or_without_a_place_panics() {
        let mut drawing = Drawing::new(0, 100_000, WHITE);
        assert_eq!(drawing.size_px(), (1, MAX_DRAWING_PX));
        let far = Spot::new(1e300, -1e300);
        drawing.line(vec![far, Spot::new(f64::NAN, 0.0)], RED, 1.0);
        drawing.line(vec![far, Spot::default(), Spot::new(-1e18, 5.0)], RED, 1.0);
        drawing.disc(far, 1e9, RED);
        drawing.disc(Spot::new(f64::INFINITY, 0.0), 3.0, RED);
        drawing.rectangle(far, Spot::default(), RED);
        drawing.image(
            Image {
                width: 1,
                pixels: vec![RED],
            },
            (u32::MAX, 5),
            9,
        );
        drawing.text(Text {
            text: "far".to_owned(),
            at: far,
            scale: 3,
            colour: RED,
            halo: Some(WHITE),
        });
        for format in [PictureFormat::Png, PictureFormat::Svg] {
            assert!(!drawing.to_bytes(format).unwrap().is_empty());
        }
    }

    #[test]
    fn formats_are_told_by_the_name() {
        let of = |name: &str| PictureFormat::of_path(Path::new(name));
        assert_eq!(of("a.PNG"), Some(PictureFormat::Png));
        assert_eq!(of("a.b/c.svg"), Some(PictureFormat::Svg));
        assert_eq!((of("a.jpg"), of("png"), of("")), (None, None, None));
    }
}
