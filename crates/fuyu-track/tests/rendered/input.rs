//! Darkness, changes of size, frames that cannot be used.

use fuyu_track::{Image, Settings, TrackError, Tracker};

use crate::{
    RATE, run,
    world::{World, textured_box},
};

/// Fails if an id is used for two points: all of those before and after darkness differ.
#[test]
fn points_after_an_eclipse_have_new_ids() {
    let world = World::new(textured_box());
    let mut tracker = Tracker::new(Settings::default()).unwrap();
    let dark = vec![0; 640 * 480];
    let mut before = 0;
    let mut after = u32::MAX;
    for k in 0..40 {
        let view = world.view(f64::from(k) / RATE);
        let eclipse = (10..30).contains(&k);
        let data = if eclipse { &dark } else { &view.grey };
        let image = Image::new(640, 480, 640, data).unwrap();
        let features = tracker.track(f64::from(k) / RATE, image, None).unwrap();
        let ids = features.iter().map(|f| f.id);
        match k {
            0..10 => before = ids.max().unwrap_or(0).max(before),
            10..30 => assert_eq!(features.len(), 0, "frame {k}"),
            _ => after = ids.min().unwrap_or(u32::MAX).min(after),
        }
    }
    assert!(before > 0 && after < u32::MAX);
    assert!(after > before, "{before} {after}");
}

/// Fails if bytes beyond a row are looked at.
#[test]
fn padding_of_rows_changes_nothing() {
    let world = World::new(textured_box());
    let settings = Settings::default();
    let [mut plain, mut padded] = [0; 2].map(|_| Tracker::new(settings.clone()).unwrap());
    for k in 0..9 {
        let time = f64::from(k) / RATE;
        let view = world.view(time);
        let image = Image::new(640, 480, 640, &view.grey).unwrap();
        let mut wide = vec![255; 480 * 771];
        for (row, source) in wide.chunks_exact_mut(771).zip(view.grey.chunks_exact(640)) {
            row[..640].copy_from_slice(source);
        }
        let other = Image::new(640, 480, 771, &wide).unwrap();
        assert_eq!(
            plain.track(time, image, None).unwrap(),
            padded.track(time, other, None).unwrap()
        );
    }
}

/// Fails if a frame that cannot be used changes the tracker, or a change of size is not survived.
#[test]
fn wrong_frames_are_refused_and_sizes_may_change() {
    let mut tracker = Tracker::new(Settings::default()).unwrap();
    let view = World::new(textured_box()).view(0.0);
    let image = Image::new(640, 480, 640, &view.grey).unwrap();
    for k in 0..8 {
        tracker.track(f64::from(k), image, None).unwrap();
    }
    let (time, last) = (7.0, 7.0);
    let late = tracker.track(time, image, None).unwrap_err();
    assert_eq!(late, TrackError::Time { time, last });
    assert!(tracker.track(f64::NAN, image, None).is_err());
    let small = Image::new(33, 35, 640, &view.grey).unwrap();
    assert_eq!(
        tracker.track(8.0, image, Some(small)).unwrap_err(),
        TrackError::MaskSize(33, 35, 640, 480)
    );
    let known = tracker.track(8.0, image, None).unwrap();
    assert!(known.iter().filter(|f| f.frames == 9).count() > 30);
    // Odd sizes, also those of which the coarsest level is smaller than the window.
    let mut newest = 0;
    for (k, (w, h)) in [(33, 35), (639, 479), (321, 32), (640, 480)]
        .into_iter()
        .enumerate()
    {
        for j in 0..8 {
            let image = Image::new(w, h, 640, &view.grey).unwrap();
            let time = 9.0 + 8.0 * k as f64 + f64::from(j);
            for f in tracker.track(time, image, None).unwrap() {
                assert!(f.u.is_finite() && f.u < w as f64 && f.v < h as f64);
                newest = f.id.max(newest);
            }
        }
    }
    assert!(newest > known.last().unwrap().id);
    assert!(tracker.losses().resized > 30);
}

/// Fails if a result depends on anything but the images.
#[test]
fn equal_images_give_equal_points() {
    let world = World::new(textured_box());
    let [a, b] = [0; 2].map(|_| run(&world, Settings::default(), 20, false).frames);
    assert_eq!(a, b);
}
