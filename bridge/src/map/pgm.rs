//! Grey pictures in the PGM formats P5 (bytes) and P2 (decimal text), 8 bits a pixel.

use std::path::Path;

use crate::Error;
use crate::geometry::MAX_GRID_SIDE_CELLS;

/// Most bytes that a picture's file may have: the largest grid as text, and some comments.
pub const MAX_FILE_BYTES: u64 = 4 * (MAX_GRID_SIDE_CELLS as u64).pow(2) + 64 * 1024;

/// A grey picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pgm {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row by row from the top; 0 is black, 255 white.
    pub pixels: Vec<u8>,
}

impl Pgm {
    /// The picture of a file's bytes; `path` is for errors only.
    ///
    /// Grey values of files whose greatest value is below 255 are scaled up to it.
    ///
    /// # Errors
    /// [`Error::BadFile`] says what was found and expected at which byte.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, Error> {
        Parser {
            bytes,
            offset: 0,
            path,
        }
        .picture()
    }

    /// The picture as a P5 file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = format!("P5\n{} {}\n255\n", self.width, self.height).into_bytes();
        bytes.extend_from_slice(&self.pixels);
        bytes
    }
}

struct Parser<'a> {
    bytes: &'a [u8],
    offset: usize,
    path: &'a Path,
}

impl Parser<'_> {
    fn picture(mut self) -> Result<Pgm, Error> {
        let is_binary = match self.bytes.get(..2) {
            Some(b"P5") => true,
            Some(b"P2") => false,
            found => {
                let found = String::from_utf8_lossy(found.unwrap_or(self.bytes)).into_owned();
                return Err(self.bad(
                    0,
                    &format!("found {found:?}, expected a PGM picture (P5 or P2) or a PNG picture"),
                ));
            }
        };
        self.offset = 2;
        let width = self.number("the width", MAX_GRID_SIDE_CELLS)?;
        let height = self.number("the height", MAX_GRID_SIDE_CELLS)?;
        let greatest = self.number("the greatest grey value", 255)?;
        let len = width as usize * height as usize;
        let pixels = if is_binary {
            self.binary(len)?
        } else {
            self.text(len, greatest)?
        };
        Ok(Pgm {
            width,
            height,
            pixels: self.scaled(pixels, greatest)?,
        })
    }

    fn binary(&mut self, len: usize) -> Result<Vec<u8>, Error> {
        // Exactly one white-space byte parts the header from the pixels, which may look like one.
        self.offset += 1;
        let found = self.bytes.get(self.offset..).unwrap_or_default();
        match found.get(..len) {
            Some(pixels) => Ok(pixels.to_vec()),
            None => Err(self.bad(
                self.bytes.len(),
                &format!("the file ends after {} of {len} pixels", found.len()),
            )),
        }
    }

    fn text(&mut self, len: usize, greatest: u32) -> Result<Vec<u8>, Error> {
        // A pixel takes a byte and a space at least, so that the header cannot claim memory.
        let mut pixels = Vec::with_capacity(len.min(self.bytes.len()));
        for _ in 0..len {
            let value = self.token("a grey value")?;
            let Ok(grey) = u8::try_from(value) else {
                return Err(self.bad(
                    self.offset,
                    &format!("grey {value}, expected 0 to {greatest}"),
                ));
            };
            pixels.push(grey);
        }
        Ok(pixels)
    }

    fn scaled(&self, mut pixels: Vec<u8>, greatest: u32) -> Result<Vec<u8>, Error> {
        if greatest == 255 {
            return Ok(pixels);
        }
        for (index, pixel) in pixels.iter_mut().enumerate() {
            let scaled = (u32::from(*pixel) * 255 + greatest / 2) / greatest;
            *pixel = u8::try_from(scaled).map_err(|_ignored| {
                self.bad(
                    self.offset,
                    &format!("pixel {index} is {pixel}, expected 0 to {greatest}"),
                )
            })?;
        }
        Ok(pixels)
    }

    fn number(&mut self, what: &str, most: u32) -> Result<u32, Error> {
        let value = self.token(what)?;
        if (1..=most).contains(&value) {
            return Ok(value);
        }
        Err(self.bad(
            self.offset,
            &format!("{what} is {value}, expected 1 to {most}"),
        ))
    }

    /// The next decimal number, behind white space and comments.
    fn token(&mut self, what: &str) -> Result<u32, Error> {
        loop {
            match self.bytes.get(self.offset) {
                Some(byte) if byte.is_ascii_whitespace() => self.offset += 1,
                Some(b'#') => {
                    let rest = &self.bytes[self.offset..];
                    let line = rest.iter().position(|byte| *byte == b'\n');
                    self.offset += line.unwrap_or(rest.len());
                }
                _ => break,
            }
        }
        let from = self.offset;
        let digits = self.bytes[from..]
            .iter()
            .take_while(|byte| byte.is_ascii_digit())
            .count();
        self.offset += digits;
        std::str::from_utf8(&self.bytes[from..from + digits])
            .ok()
            .and_then(|digits| digits.parse().ok())
            .ok_or_else(|| self.bad(from, &format!("expected {what}, a decimal number")))
    }

    fn bad(&self, offset: usize, what: &str) -> Error {
        Error::BadFile {
            path: self.path.to_owned(),
            what: format!("byte {offset}: {what}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(bytes: &[u8]) -> Result<Pgm, Error> {
        Pgm::parse(bytes, Path::new("map.pgm"))
    }

    #[test]
    fn text_comments_and_small_ranges_are_read() {
        let pgm = parse(b"P2 # a map\n# 9 9\n2 2\n15\n0 15\n7 8\n").unwrap();
        assert_eq!((pgm.width, pgm.height), (2, 2));
        assert_eq!(pgm.pixels, [0, 255, 119, 136]);
        assert_eq!(parse(b"P5\n1 2\n255\n#\n").unwrap().pixels, *b"#\n");
    }

    #[test]
    fn errors_name_the_byte() {
        for (bytes, what) in [
            (&b"P6\n1 1\n255\n000"[..], "byte 0: found \"P6\""),
            (b"", "byte 0: found \"\""),
            (b"P5\n2 x", "byte 5: expected the height"),
            (
                b"P5\n2 2\n255\nabc",
                "byte 14: the file ends after 3 of 4 pixels",
            ),
            (
                b"P5\n2 2\n65535\nabcdefgh",
                "the greatest grey value is 65535",
            ),
            (b"P5\n999999999 2\n255\n", "the width is 999999999"),
            (b"P5\n0 2\n255\n", "the width is 0"),
            (b"P2\n1 1\n7\n8\n", "pixel 0 is 8"),
            (b"P2\n1 1\n255\n256\n", "grey 256"),
            (b"P5 1 1 255", "the file ends after 0 of 1"),
        ] {
            let error = parse(bytes).unwrap_err().to_string();
            assert!(error.contains("map.pgm") && error.contains(what), "{error}");
        }
    }

    proptest! {
        #[test]
        fn a_picture_is_read_back(width in 1u32..9, pixels in proptest::collection::vec(any::<u8>(), 8..80)) {
            let height = u32::try_from(pixels.len()).unwrap() / width;
            let pixels = pixels[..(width * height) as usize].to_vec();
            let pgm = Pgm { width, height, pixels };
            prop_assert_eq!(parse(&pgm.to_bytes()).unwrap(), pgm);
        }

        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..60), head in 0usize..4) {
            let head = [&b""[..], b"P5 ", b"P2\n3 2\n", b"P5\n4096 4096\n255\n"][head];
            let _either_way = parse(&[head, &bytes].concat());
        }
    }
}
