//! What is not the target.

use fuyu_track::{Settings, Target};

use crate::{
    run,
    world::{BODY, World, textured_box},
};

/// Fails if the default region of the image contains stars. Without it, they are among the points: the test knows that
/// there are stars to be tracked.
#[test]
fn stars_are_never_tracked() {
    let world = World {
        stars: 2e4,
        ..World::new(textured_box())
    };
    let off = |settings| {
        let run = run(&world, settings, 14, false);
        let frames = run.frames.iter().zip(&run.views);
        let features = frames.flat_map(|(features, view)| features.iter().map(move |f| (f, view)));
        let (all, off) = features.fold((0, 0), |(all, off), (f, view)| {
            (all + 1, off + usize::from(view.id(f.u, f.v) != BODY))
        });
        println!("{off} of {all}");
        (all, off)
    };
    let (all, stars) = off(Settings::default());
    assert!(all > 300, "{all}");
    assert_eq!(stars, 0);
    let (_, stars) = off(Settings {
        target: Target::Everything,
        margin: 0,
        rigid_frames: 0,
        ..Settings::default()
    });
    assert!(stars > 20, "{stars}");
}

/// Fails if points of the arm are tracked, or points of the body slide along with the arm.
#[test]
fn the_arm_in_front_is_not_tracked_with_a_mask() {
    let world = World {
        arm: true,
        ..World::new(textured_box())
    };
    let run = run(&world, Settings::default(), 60, true);
    let mut covered = 0;
    for (features, view) in run.frames.iter().zip(&run.views) {
        for f in features {
            assert_eq!(view.id(f.u, f.v), BODY, "{f:?}");
        }
        covered += usize::from(view.frame.ids.contains(&crate::world::ARM));
    }
    assert!(covered > 20, "the arm is in {covered} frames only");
    let worst = run.observations.iter().map(|o| o.error).fold(0.0, f64::max);
    assert!(worst < 3.0, "{worst} px");
}
