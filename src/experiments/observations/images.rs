//! Feature tracks from a folder of PNG images.

use std::path::{Path, PathBuf};

use crate::{
    estimation::Tracks,
    nodes::tracker::{Grey, ImageTracker},
};

use super::{ObservedTracks, Tracking, masks::Masks, png};

/// Number of digits from which a file name is a time in nanoseconds; in 2001 it had 18.
const NANOSECONDS: usize = 16;

/// Whether the folder contains PNG files and is not a bag.
pub(super) fn is_folder_of_images(path: &Path) -> bool {
    path.is_dir()
        && !path.join("metadata.yaml").exists()
        && files(path).is_ok_and(|f| !f.is_empty())
}

/// Tracks points through the PNG files of a folder. Without a frame rate, file names are times; with a frame rate,
/// files are in the order of their names.
///
/// # Errors
/// A line that names the file.
pub(super) fn read(folder: &Path, tracking: &Tracking) -> Result<ObservedTracks, String> {
    let params = &tracking.params;
    if let (Some(id), None) = (params.mask_id, &tracking.mask) {
        return Err(format!(
            "{}: is a folder of PNG files, so that masks with the id {id} must be given by --mask",
            folder.display()
        ));
    }
    let masks = Masks::new(tracking.mask.as_deref(), params.mask_id)?;
    let mut tracker = ImageTracker::new(params.clone()).map_err(|e| e.to_string())?;
    let mut frames = Vec::new();
    for (time, path) in timed(files(folder)?, tracking.frame_rate)? {
        let at = |e: String| format!("{}: {e}", path.display());
        let luminance = png::read(&path)?.into_luma8();
        let (width, height) = luminance.dimensions();
        let grey =
            Grey::from_values(width as usize, height as usize, luminance.into_raw()).map_err(at)?;
        let mask = masks.of(&path)?;
        frames.push(tracker.track_grey(time, &grey, mask.as_ref()).map_err(at)?);
    }
    let images = frames.len();
    frames.retain(|frame| !frame.features.is_empty());
    if frames.is_empty() {
        return Err(format!(
            "{}: shows no points of a body that could be tracked in {images} images",
            folder.display()
        ));
    }
    Ok(ObservedTracks {
        tracks: Tracks::new(frames).map_err(|e| format!("{}: {e}", folder.display()))?,
        camera: None,
        distortion: None,
        w_WC_C: Vec::new(),
        gyro_noise: None,
        ranges: Vec::new(),
        ignored_clouds: None,
    })
}

/// The PNG files of a folder in order of their names.
fn files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let at = |e: std::io::Error| format!("{}: {e}", folder.display());
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(at)? {
        let path = entry.map_err(at)?.path();
        let is_png = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("png"));
        if is_png {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Files with their times \[s\], in order of time.
fn timed(files: Vec<PathBuf>, frame_rate: Option<f64>) -> Result<Vec<(f64, PathBuf)>, String> {
    if let Some(rate) = frame_rate {
        let times = files.into_iter().enumerate();
        return Ok(times.map(|(k, path)| (k as f64 / rate, path)).collect());
    }
    // Nanoseconds since 1970 need more digits than a double has: times are relative to the first file.
    let mut first = None;
    let mut timed = Vec::new();
    for path in files {
        let name = path.file_stem().and_then(|s| s.to_str()).unwrap_or("");
        let digits = name.bytes().all(|b| b.is_ascii_digit());
        let time = match digits && name.len() >= NANOSECONDS {
            true => name.parse::<u64>().ok().map(|ns| {
                let from = *first.get_or_insert(ns);
                // Names of equal length are sorted by time; names of different lengths may not be.
                ns.abs_diff(from) as f64 * if ns < from { -1e-9 } else { 1e-9 }
            }),
            false => name.parse().ok().filter(|t: &f64| t.is_finite()),
        };
        let Some(time) = time else {
            return Err(format!(
                "{}: the name is no time; it must be one in seconds (12.35.png) or in nanoseconds of {NANOSECONDS} digits or more, or give --frame-rate",
                path.display()
            ));
        };
        timed.push((time, path));
    }
    timed.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(timed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_seconds_nanoseconds_or_an_order() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let times = |names: &[&str], rate| {
            let timed = timed(paths(names), rate).unwrap();
            timed.into_iter().map(|(t, _)| t).collect::<Vec<_>>()
        };
        assert_eq!(times(&["10.5.png", "9.25.png"], None), [9.25, 10.5]);
        let ns = ["1403636579763555584.png", "1403636579813555456.png"];
        let found = times(&ns, None);
        assert!(found[0] == 0.0 && (found[1] - 0.049_999_872).abs() < 1e-15);
        assert_eq!(times(&["a.png", "b.png"], Some(4.0)), [0.0, 0.25]);
        let problem = timed(paths(&["x/frame_1.png"]), None).unwrap_err();
        assert!(problem.starts_with("x/frame_1.png: the name is no time"));
        assert!(timed(paths(&["nan.png"]), None).is_err());
    }
}
