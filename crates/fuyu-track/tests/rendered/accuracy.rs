//! Drift, identity and life of tracks.

use fuyu_track::Settings;
use nalgebra::Vector3;

use crate::{
    quantile, run,
    world::{World, textured_box},
};

/// Fails if points drift, switch to others, or stay where a limb or an edge has hidden them.
#[test]
fn points_stay_on_the_body_until_the_limb_hides_them() {
    for (light, sun) in [
        ("front", Vector3::new(-0.4, -0.5, -1.0)),
        ("side", Vector3::new(-1.0, -0.3, -0.2)),
    ] {
        let world = World {
            sun,
            ..World::new(textured_box())
        };
        let run = run(&world, Settings::default(), 60, false);
        let counts = run.frames.iter().skip(10).map(|f| f.len() as f64);
        let count = quantile(counts, 0.5);
        let aged = || run.observations.iter().filter(|o| o.age > 0);
        let errors = || aged().map(|o| o.error);
        let old = aged().filter(|o| o.age >= 30).count();
        let (median, most, worst) = (
            quantile(errors(), 0.5),
            quantile(errors(), 0.95),
            quantile(errors(), 1.0),
        );
        let hidden = aged().filter(|o| o.hidden).count() as f64 / aged().count() as f64;
        println!(
            "{light}: {count} points, median {median:.3}, 95 % {most:.3}, worst {worst:.2} px, hidden {hidden:.4}, {old} old"
        );
        assert!(count >= 40.0, "{light}: {count} points");
        assert!(median < 0.15, "{light}: median {median} px");
        assert!(most < 0.6, "{light}: 95 % {most} px");
        // A point that takes another's id would be a spacing away at least.
        assert!(worst < 3.0, "{light}: worst {worst} px");
        assert!(hidden < 0.01, "{light}: {hidden} of the points are hidden");
        assert!(old > 500, "{light}: {old}");
    }
}

/// Fails without the prediction: a level of the pyramid shows at most some pixels of motion, and the body moves by 30 px.
#[test]
fn fast_motion_is_followed() {
    let world = World {
        position: Vector3::new(-2.0, -0.8, 8.0),
        velocity: Vector3::new(3.6, 1.2, 0.0),
        ..World::new(textured_box())
    };
    let run = run(&world, Settings::default(), 14, false);
    for pair in run.frames[6..].windows(2) {
        let survived = |id| pair[1].iter().any(|f| f.id == id);
        let kept = pair[0].iter().filter(|f| survived(f.id)).count();
        assert!(
            10 * kept >= 8 * pair[0].len() && kept >= 20,
            "{kept} of {} points",
            pair[0].len()
        );
    }
    let errors = || run.observations.iter().map(|o| o.error);
    assert!(quantile(errors(), 0.95) < 0.6);
    assert!(quantile(errors(), 1.0) < 3.0);
}
