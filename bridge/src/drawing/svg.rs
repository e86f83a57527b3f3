//! A drawing as SVG.

use std::fmt::Write;

use super::{Drawing, GLYPH_PX, Image, Item, Spot, Text, png_of};
use crate::Error;
use crate::picture::Colour;

/// Size of a font whose letters are as high as those of the PNG file, for a letter of one pixel.
const FONT_SIZE: f64 = 1.2;
/// Height of a line's letters above its base, of their size.
const ASCENT: f64 = 0.85;

/// The file's text.
///
/// # Errors
/// As [`png_of`], of the images.
pub(super) fn text_of(drawing: &Drawing) -> Result<String, Error> {
    let (width, height) = drawing.size_px();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\">\n<rect width=\"{width}\" height=\"{height}\" \
         fill=\"{}\"/>\n",
        hex(drawing.ground)
    );
    for item in &drawing.items {
        let line = match item {
            Item::Image { image, at, scale } => image_of(image, *at, *scale)?,
            Item::Line {
                spots,
                colour,
                width_px,
            } => format!(
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width_px}\" \
                 stroke-linecap=\"round\" stroke-linejoin=\"round\"/>",
                points_of(spots),
                hex(*colour)
            ),
            Item::Disc {
                centre,
                radius_px,
                colour,
            } => format!(
                "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{radius_px}\" fill=\"{}\"/>",
                centre.x,
                centre.y,
                hex(*colour)
            ),
            Item::Rectangle { from, to, colour } => format!(
                "<rect x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{:.2}\" fill=\"{}\"/>",
                from.x,
                from.y,
                (to.x - from.x).max(0.0),
                (to.y - from.y).max(0.0),
                hex(*colour)
            ),
            Item::Text(text) => line_of(text),
        };
        svg.push_str(&line);
        svg.push('\n');
    }
    svg.push_str("</svg>\n");
    Ok(svg)
}

fn image_of(image: &Image, (left, top): (u32, u32), scale: u32) -> Result<String, Error> {
    let (width, height) = (image.width, image.height());
    let data = base64_of(&png_of(width, height, &image.pixels)?);
    let (wide, high) = (
        u64::from(width) * u64::from(scale),
        u64::from(height) * u64::from(scale),
    );
    Ok(format!(
        "<image x=\"{left}\" y=\"{top}\" width=\"{wide}\" height=\"{high}\" \
         preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" \
         href=\"data:image/png;base64,{data}\"/>"
    ))
}

fn line_of(text: &Text) -> String {
    let size_px = f64::from(GLYPH_PX * text.scale) * FONT_SIZE;
    let halo = text.halo.map_or_else(String::new, |halo| {
        let halo = hex(halo);
        format!(" stroke=\"{halo}\" stroke-width=\"4\" paint-order=\"stroke\"")
    });
    format!(
        "<text x=\"{:.2}\" y=\"{:.2}\" font-family=\"monospace\" font-size=\"{size_px}\" \
         textLength=\"{}\" lengthAdjust=\"spacingAndGlyphs\" xml:space=\"preserve\" \
         fill=\"{}\"{halo}>{}</text>",
        text.at.x,
        text.at.y + ASCENT * f64::from(GLYPH_PX * text.scale),
        Text::width_px(&text.text, text.scale),
        hex(text.colour),
        escaped(&text.text)
    )
}

fn points_of(spots: &[Spot]) -> String {
    let mut points = String::new();
    for spot in spots {
        // Writing to a string does not fail.
        let _ = write!(points, "{:.2},{:.2} ", spot.x, spot.y);
    }
    points
}

fn hex([red, green, blue]: Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            // XML has no such characters.
            '\u{0}'..='\u{1f}' => escaped.push('\u{fffd}'),
            _ => escaped.push(character),
        }
    }
    escaped
}

/// Base 64 of RFC 4648.
fn base64_of(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for part in bytes.chunks(3) {
        let byte = |index: usize| u32::from(part.get(index).copied().unwrap_or_default());
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for index in 0..4 {
            if index <= part.len() {
                let letter = LETTERS[(bits >> (18 - 6 * index)) as usize & 63];
                text.push(char::from(letter));
            } else {
                text.push('=');
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_rfc() {
        for (bytes, text) in [
            (&b""[..], ""),
            (b"f", "Zg=="),
            (b"fo", "Zm8="),
            (b"foo", "Zm9v"),
            (b"foob", "Zm9vYg=="),
            (b"foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64_of(bytes), text);
        }
    }
}
