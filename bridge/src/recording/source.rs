//! The bytes of a recording: a file as it is, or one that was compressed as a whole (`.mcap.zstd`).

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use crate::Error;

/// Bytes read from the file at a time.
const BUFFER_BYTES: usize = 256 * 1024;
/// What a file that was compressed with zstd begins with.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Most bytes that a compressed file may have unpacked.
const MOST_UNPACKED_BYTES: u64 = 1024 * 1024 * 1024 * 1024;

/// A recording's bytes, read and sought in.
#[derive(Debug)]
pub struct Source(Kind);

#[derive(Debug)]
enum Kind {
    Plain(BufReader<File>),
    Zstd(Box<ZstdFile>),
}

impl Source {
    /// Opens a file, compressed or not.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::BadFile`] for a folder or a device.
    pub(super) fn open(path: &Path) -> Result<Self, Error> {
        let io = |source| Error::Io {
            path: path.to_owned(),
            source,
        };
        let mut file = File::open(path).map_err(io)?;
        let kind = file.metadata().map_err(io)?;
        if !kind.is_file() {
            let what = if kind.is_dir() {
                "a folder, expected an MCAP file: give the files in it"
            } else {
                "no regular file, expected an MCAP file"
            };
            return Err(Error::BadFile {
                path: path.to_owned(),
                what: what.to_owned(),
            });
        }
        let mut first = [0; ZSTD_MAGIC.len()];
        let is_packed = match file.read_exact(&mut first) {
            Ok(()) => first == ZSTD_MAGIC,
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => false,
            Err(error) => return Err(io(error)),
        };
        file.rewind().map_err(io)?;
        Ok(Self(if is_packed {
            Kind::Zstd(Box::new(ZstdFile::open(file).map_err(io)?))
        } else {
            Kind::Plain(BufReader::with_capacity(BUFFER_BYTES, file))
        }))
    }

    /// Why less of a compressed file can be unpacked than was packed, if that is so.
    pub(super) fn damage(&self) -> Option<&str> {
        match &self.0 {
            Kind::Plain(_) => None,
            Kind::Zstd(file) => file.damage.as_deref(),
        }
    }
}

impl Read for Source {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match &mut self.0 {
            Kind::Plain(file) => file.read(buffer),
            Kind::Zstd(file) => file.read(buffer),
        }
    }
}

impl Seek for Source {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match &mut self.0 {
            Kind::Plain(file) => file.seek(to),
            Kind::Zstd(file) => file.seek(to),
        }
    }

    fn seek_relative(&mut self, distance: i64) -> io::Result<()> {
        match &mut self.0 {
            // Within the buffer this reads nothing anew.
            Kind::Plain(file) => file.seek_relative(distance),
            Kind::Zstd(file) => file.seek(SeekFrom::Current(distance)).map(drop),
        }
    }
}

type Decoder = zstd::stream::read::Decoder<'static, BufReader<File>>;

/// A file that was compressed as a whole. Seeking back unpacks it from its beginning again, so that no
/// more of it than a buffer is ever in memory.
struct ZstdFile {
    decoder: Decoder,
    file: File,
    position: u64,
    /// Bytes that can be unpacked.
    len: u64,
    damage: Option<String>,
}

impl std::fmt::Debug for ZstdFile {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("ZstdFile")
            .field("position", &self.position)
            .field("len", &self.len)
            .finish_non_exhaustive()
    }
}

impl ZstdFile {
    fn open(file: File) -> io::Result<Self> {
        let mut opened = Self {
            decoder: decoder_of(&file)?,
            file,
            position: 0,
            len: 0,
            damage: None,
        };
        opened.measure();
        opened.restart()?;
        Ok(opened)
    }

    /// Unpacks everything once, for its length and for damage.
    fn measure(&mut self) {
        let mut buffer = vec![0; BUFFER_BYTES];
        loop {
            match self.decoder.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => self.len += u64::try_from(count).unwrap_or(0),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    self.damage = Some(format!("the zstd data end early: {error}"));
                    break;
                }
            }
            if self.len > MOST_UNPACKED_BYTES {
                self.damage = Some(format!(
                    "more than {MOST_UNPACKED_BYTES} bytes unpacked, which is the limit"
                ));
                self.len = MOST_UNPACKED_BYTES;
                break;
            }
        }
    }

    fn restart(&mut self) -> io::Result<()> {
        self.decoder = decoder_of(&self.file)?;
        self.position = 0;
        Ok(())
    }
}

fn decoder_of(file: &File) -> io::Result<Decoder> {
    let mut file = file.try_clone()?;
    file.rewind()?;
    Decoder::with_buffer(BufReader::with_capacity(BUFFER_BYTES, file))
}

impl Read for ZstdFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = usize::try_from(self.len - self.position).unwrap_or(usize::MAX);
        let wanted = buffer.len().min(left);
        if wanted == 0 {
            return Ok(0);
        }
        let count = self.decoder.read(&mut buffer[..wanted])?;
        self.position += u64::try_from(count).unwrap_or(0);
        Ok(count)
    }
}

impl Seek for ZstdFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let target = match to {
            SeekFrom::Start(target) => Some(target),
            SeekFrom::End(distance) => self.len.checked_add_signed(distance),
            SeekFrom::Current(distance) => self.position.checked_add_signed(distance),
        };
        // Nobody has to read behind the end, and unpacking up to there would not end.
        let target = target
            .filter(|target| *target <= self.len)
            .ok_or(io::ErrorKind::InvalidInput)?;
        // Nothing is unpacked for where reading is not going to go on.
        if target == self.len {
            if self.position != self.len {
                self.position = self.len;
                self.decoder = decoder_of(&self.file)?;
            }
            return Ok(target);
        }
        if target < self.position {
            self.restart()?;
        }
        let distance = target - self.position;
        let skipped = io::copy(&mut self.take(distance), &mut io::sink())?;
        if skipped == distance {
            Ok(target)
        } else {
            Err(io::ErrorKind::UnexpectedEof.into())
        }
    }
}
