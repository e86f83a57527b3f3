//! Pictures, their YAML files, and files of poses, chosen by the first byte.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use swath_bridge::goals::{format_poses, parse_poses};
use swath_bridge::map::{MapYaml, Pgm};

fuzz_target!(|data: &[u8]| {
    let Some((&kind, rest)) = data.split_first() else {
        return;
    };
    let path = Path::new("fuzz");
    match kind % 3 {
        0 => {
            if let Ok(picture) = Pgm::parse(rest, path) {
                let again =
                    Pgm::parse(&picture.to_bytes(), path).expect("what was written is read");
                assert_eq!(again.pixels, picture.pixels);
            }
        }
        1 => {
            let _ = MapYaml::parse(&String::from_utf8_lossy(rest), path);
        }
        _ => {
            if let Ok(poses) = parse_poses(&String::from_utf8_lossy(rest), path) {
                assert!(poses.iter().all(swath_bridge::Pose2::is_finite));
                let again = parse_poses(&format_poses(&poses), path);
                assert_eq!(again.expect("what was written is read").len(), poses.len());
            }
        }
    }
});
