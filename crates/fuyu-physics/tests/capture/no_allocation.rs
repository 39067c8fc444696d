//! Steps with contact do not allocate.

use allocation_counter::measure;
use fuyu_physics::dynamics::contact::{Bristle, ContactLaw};
use nalgebra::Vector3;

use crate::gripper::{law, scene};

#[test]
fn steps_with_contact_do_not_allocate() {
    let bristle = Bristle {
        stiffness: 1e4,
        damping: 1e2,
    };
    for bristle in [None, Some(bristle)] {
        let law = ContactLaw { bristle, ..law() };
        let mut world = scene(law, Vector3::new(0.03, 0.04, -0.036));
        world.step(0.01).unwrap();
        // The fingers close, touch, and hold.
        let used = measure(|| (0..50).for_each(|_| world.step(0.01).unwrap()));
        assert_eq!(used.count_total, 0);
        assert!(world.work().events > 0 && world.contacts().count() == 4);
    }
}
