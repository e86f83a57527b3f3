//! Draws samples of every kind of scene, side by side, to look at: obstacles black, the reference
//! blue, the label green, the target red.
//!
//! `cargo run --release -p swath-generator --example pictures -- DIR [SEED] [COLUMNS] [LOG]`
//!
//! With a drive log there is one sheet, of its scenes.

use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

use swath_bridge::ingest::IngestConfig;
use swath_bridge::msg::swath::Sample;
use swath_generator::{
    Generator, GeneratorConfig, LogScenes, SAMPLES_PER_TARGET, SceneKind, Scenes,
};
use swath_planner::search::SearchMemory;

const SCALE: usize = 2;
const GAP: usize = 6;

struct Sheet {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Sheet {
    fn new(columns: usize, rows: usize, cols: usize) -> Self {
        let (width, height) = (columns * (cols * SCALE + GAP), rows * SCALE);
        Self {
            width,
            height,
            pixels: vec![128; width * height * 3],
        }
    }

    fn draw(&mut self, column: usize, sample: &Sample) {
        let (rows, cols) = (sample.rows as usize, sample.cols as usize);
        let is_set = |plane: &[u8], index: usize| plane[index / 8] & (0x80 >> (index % 8)) != 0;
        for y in 0..rows * SCALE {
            for x in 0..cols * SCALE {
                let index = (y / SCALE) * cols + x / SCALE;
                let mut colour = [255_u8; 3];
                if is_set(&sample.reference, index) {
                    colour = [190, 205, 255];
                }
                if is_set(&sample.label, index) {
                    colour = [120, 220, 120];
                }
                if is_set(&sample.target, index) {
                    colour = [230, 60, 60];
                }
                if is_set(&sample.obstacles, index) {
                    colour = [0; 3];
                }
                let at = (y * self.width + column * (cols * SCALE + GAP) + x) * 3;
                self.pixels[at..at + 3].copy_from_slice(&colour);
            }
        }
    }

    fn save(&self, path: &Path) -> Result<(), Box<dyn Error>> {
        let file = BufWriter::new(File::create(path)?);
        let (width, height) = (u32::try_from(self.width)?, u32::try_from(self.height)?);
        let mut encoder = png::Encoder::new(file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header()?.write_image_data(&self.pixels)?;
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let directory = arguments
        .next()
        .ok_or("usage: pictures DIR [SEED] [COLUMNS] [LOG]")?;
    let seed: u64 = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let columns: u64 = arguments.next().map_or(Ok(5), |text| text.parse())?;
    std::fs::create_dir_all(&directory)?;
    let Some(log) = arguments.next() else {
        let generator = Generator::new(GeneratorConfig::default(), Scenes::Procedural)?;
        let kinds = SceneKind::ALL.len() as u64;
        for (kind_index, kind) in (0..).zip(SceneKind::ALL) {
            let path = Path::new(&directory).join(format!("{}.png", kind.name()));
            let indices = (0..columns).map(|column| column * kinds + kind_index);
            draw_sheet(&generator, seed, indices.collect(), &path)?;
        }
        return Ok(());
    };
    let mut logs = LogScenes::new();
    let frames = swath_bridge::ingest::frames(Path::new(&log), &IngestConfig::default())?;
    logs.add("log", frames)?;
    let generator = Generator::new(GeneratorConfig::default(), Scenes::Logs(Arc::new(logs)))?;
    let path = Path::new(&directory).join("log.png");
    draw_sheet(&generator, seed, (0..columns).collect(), &path)
}

/// Draws the first sample of each scene.
fn draw_sheet(
    generator: &Generator,
    seed: u64,
    scenes: Vec<u64>,
    path: &Path,
) -> Result<(), Box<dyn Error>> {
    let grid = generator.config().grid;
    let mut memory = SearchMemory::new();
    let mut sheet = Sheet::new(scenes.len(), grid.rows as usize, grid.cols as usize);
    for (column, scene) in scenes.into_iter().enumerate() {
        let sample = generator.sample(seed, scene * SAMPLES_PER_TARGET, &mut memory)?;
        sheet.draw(column, &sample);
    }
    sheet.save(path)
}
