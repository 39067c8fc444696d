//! Parameter `mass_scale`: bodies that are heavier or lighter than in their descriptions.

use roxmltree::Document;

use crate::ros::Declare;

/// Attributes of `<inertia>`.
const MOMENTS: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// Declares `TARGET.mass_scale` and reads it.
pub(super) fn declare_mass_scale(declare: &mut Declare, target: &str) -> f64 {
    let parameter = declare.param(
        &format!("{target}.mass_scale"),
        1.0,
        "Factor on all masses and moments of inertia of the target's description",
    );
    parameter.range(1e-6, 1e6).read_only().value()
}

/// The description with all masses and moments of inertia multiplied by `scale`. Invalid numbers are left unchanged;
/// they are reported when the description is compiled.
pub(super) fn with_scaled_masses(xml: &str, scale: f64) -> String {
    let Ok(document) = Document::parse(xml) else {
        return xml.to_owned();
    };
    let inertials = document
        .descendants()
        .filter(|e| e.has_tag_name("inertial"))
        .flat_map(|inertial| inertial.children());
    let mut scaled = String::with_capacity(xml.len() + 64);
    let mut done = 0;
    let mut numbers: Vec<_> = inertials
        .flat_map(|e| {
            e.attributes().filter(move |a| {
                let is_mass = e.has_tag_name("mass") && a.name() == "value";
                is_mass || (e.has_tag_name("inertia") && MOMENTS.contains(&a.name()))
            })
        })
        .collect();
    numbers.sort_by_key(|attribute| attribute.range_value().start);
    for attribute in numbers {
        let Ok(number) = attribute.value().trim().parse::<f64>() else {
            continue;
        };
        let range = attribute.range_value();
        scaled += &xml[done..range.start];
        scaled += &(number * scale).to_string();
        done = range.end;
    }
    scaled + &xml[done..]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;

    #[test]
    fn masses_and_moments_are_scaled_and_nothing_else() {
        let xml = r#"<robot name="b"><!-- <mass value="9"/> --><link name="b"><inertial>
            <origin xyz="0.1 0 0"/><mass value=" 2 "/>
            <inertia ixx="1" ixy="0.1" ixz="0" iyy="1.5" iyz="0" izz="1"/></inertial></link></robot>"#;
        let scaled = with_scaled_masses(xml, 2.5);
        let [before, after] = [xml, &scaled].map(|xml| {
            let model = Model::from_urdf(xml, "b").unwrap();
            model.bodies()[0].inertia
        });
        assert_eq!(after.mass, 2.5 * before.mass);
        assert_eq!(after.com, before.com);
        assert!((after.about_com - before.about_com * 2.5).norm() < 1e-15);
        assert!(scaled.contains(r#"<mass value="9"/>"#));
    }
}
