//! The layers, as far as the compiler does not enforce them: the order of modules inside a package, the parts of the
//! standard library that the physics may use, and the dependencies of the packages. The compiler enforces the layers
//! between packages.

use std::collections::BTreeSet;

use crate::{
    cargo_tree::cargo_tree,
    sources::{PACKAGES, root, rust_files, sources},
};

/// A module and the modules that it may use.
type Layer = (&'static str, &'static [&'static str]);

/// The modules of each package, the lowest first.
const LAYERS: [(&str, &[Layer]); 8] = [
    (
        "fuyu-physics",
        &[
            ("spatial", &[]),
            ("model", &["spatial"]),
            ("dynamics", &["spatial", "model"]),
            ("vision", &["spatial"]),
            ("estimation", &["spatial", "model", "dynamics", "vision"]),
            ("control", &["spatial", "model", "dynamics", "estimation"]),
        ],
    ),
    (
        "fuyu-lti",
        &[
            ("error", &[]),
            ("matrix", &[]),
            ("eigen", &["matrix"]),
            ("lyapunov", &["matrix", "eigen"]),
            ("modes", &["matrix", "eigen"]),
            ("riccati", &["matrix", "eigen", "modes", "lyapunov"]),
            ("state_space", &["matrix", "eigen"]),
            ("transfer_function", &["matrix"]),
            ("sampling", &["matrix"]),
            ("simulation", &["matrix"]),
            ("zeros", &["matrix", "eigen"]),
            ("frequency", &["matrix"]),
            ("margins", &["matrix", "frequency"]),
            ("gramians", &["matrix", "lyapunov"]),
            (
                "norms",
                &["matrix", "eigen", "riccati", "frequency", "gramians"],
            ),
            ("reduction", &["matrix", "gramians", "riccati"]),
            ("lqr", &["matrix"]),
            ("shaped_lqr", &["matrix"]),
            ("hinf", &["matrix", "modes", "riccati"]),
            ("positive_real", &["matrix", "riccati"]),
            ("structure", &["matrix"]),
            ("proof_mass", &["matrix", "structure"]),
            ("kida1993", &["matrix", "margins", "shaped_lqr"]),
        ],
    ),
    (
        "fuyu-campaign",
        &[
            ("random", &[]),
            ("normal", &[]),
            ("beta", &[]),
            ("statistics", &["beta"]),
            ("rotation", &[]),
            ("sobol", &["random"]),
            ("covariance", &["normal"]),
            ("distribution", &["normal"]),
            ("design", &["random", "sobol"]),
        ],
    ),
    (
        "fuyu-render",
        &[
            ("motion", &[]),
            ("lens", &[]),
            ("primitives", &[]),
            // Its tests only.
            ("mesh", &["primitives"]),
            ("encode", &[]),
            ("load", &[]),
            ("urdf", &["primitives"]),
            ("earth", &[]),
            ("camera", &[]),
            ("scene", &[]),
            ("frame", &[]),
            ("sensor", &[]),
            ("stars", &[]),
            ("projection", &["camera"]),
            ("raster", &["camera", "projection"]),
            ("shadow", &["primitives", "projection"]),
            ("shade", &["projection", "shadow"]),
            (
                "render",
                &[
                    "camera",
                    "earth",
                    "projection",
                    "raster",
                    "shade",
                    "shadow",
                    "stars",
                ],
            ),
        ],
    ),
    (
        "fuyu-ros",
        &[
            ("input_file", &[]),
            ("keys", &[]),
            ("msg", &[]),
            ("ros", &["input_file", "msg"]),
            ("bag", &["input_file", "msg", "ros"]),
        ],
    ),
    (
        "fuyu-track",
        &[
            ("image", &[]),
            ("settings", &[]),
            ("region", &["image", "settings"]),
            ("patch", &["image"]),
            ("rigid", &[]),
            ("corners", &["image", "region", "settings"]),
            (
                "tracker",
                &["image", "settings", "region", "patch", "rigid", "corners"],
            ),
        ],
    ),
    (
        "fuyu-structures",
        &[
            ("error", &[]),
            ("quadrature", &[]),
            ("eigen", &["error"]),
            ("pencil", &["error", "eigen"]),
            ("matrices", &["error", "eigen"]),
            ("cantilever", &["error"]),
            ("beam", &["error", "quadrature"]),
            ("truss", &["error"]),
            ("appendage", &["error", "eigen", "matrices"]),
            ("nodal", &["error"]),
            ("outline", &["appendage"]),
            ("line", &["appendage", "quadrature", "outline"]),
            ("strip", &["error", "appendage", "line", "outline"]),
            ("link", &["error", "matrices", "strip"]),
            ("uniform", &["error", "eigen", "matrices"]),
            (
                "hybrid",
                &["error", "eigen", "pencil", "matrices", "uniform"],
            ),
            ("vehicle", &["error"]),
            ("modes_file", &["appendage"]),
            ("kida1993", &["error"]),
        ],
    ),
    (
        "fuyu",
        &[
            ("nodes", &[]),
            ("experiments", &["nodes"]),
            ("cli", &["nodes", "experiments"]),
        ],
    ),
];

#[test]
fn modules_use_only_those_below_them() {
    let (mut wrong, mut found) = (BTreeSet::new(), BTreeSet::new());
    for source in sources() {
        let module = source.module();
        if ["lib", "main", "bin"].contains(&module.as_str()) {
            continue;
        }
        let layers = LAYERS
            .iter()
            .find(|(package, _)| *package == source.package);
        let (_, layers) = layers.expect("every package is in LAYERS");
        let Some((_, below)) = layers.iter().find(|(name, _)| *name == module) else {
            wrong.insert(format!("{} is in no layer", source.location()));
            continue;
        };
        for name in source.names_below("crate") {
            let is_module = layers.iter().any(|(m, _)| *m == name);
            if is_module && name != module && !below.contains(&name.as_str()) {
                wrong.insert(format!("{} uses crate::{name}", source.location()));
            }
        }
        found.insert((source.package, module));
    }
    assert_eq!(wrong, BTreeSet::new());
    let modules: usize = LAYERS.iter().map(|(_, layers)| layers.len()).sum();
    assert_eq!(found.len(), modules, "a module has no source: {found:?}");
}

// Rayon's threads are the caller's choice (feature `batch`).
#[test]
fn physics_uses_no_files_environment_network_processes_or_threads() {
    let mut wrong = BTreeSet::new();
    let physics = [
        "fuyu-physics",
        "fuyu-structures",
        "fuyu-lti",
        "fuyu-campaign",
        "fuyu-render",
        "fuyu-track",
    ];
    for source in sources().iter().filter(|s| physics.contains(&s.package)) {
        for name in source.names_below("std") {
            if ["fs", "env", "net", "process", "thread"].contains(&name.as_str()) {
                wrong.insert(format!("{} uses std::{name}", source.location()));
            }
        }
    }
    assert_eq!(wrong, BTreeSet::new());
}

/// Names of the crates that a package depends on, directly or indirectly.
fn dependencies(package: &str) -> BTreeSet<String> {
    let tree = cargo_tree(&["--edges", "normal", "--format", "{p}", "--package", package]);
    let names = tree.iter().filter_map(|line| line.split(' ').next());
    names.map(str::to_owned).collect()
}

#[test]
fn physics_depends_on_no_ros_and_ros_on_no_physics() {
    for (package, needed, forbidden) in [
        (
            "fuyu-physics",
            "nalgebra",
            &["fuyu-ros", "ros2-client", "rustdds", "cdr-encoding", "mcap"][..],
        ),
        (
            "fuyu-structures",
            "nalgebra",
            &["fuyu-ros", "fuyu-physics", "fuyu-lti", "faer", "rustdds"],
        ),
        (
            "fuyu-campaign",
            "libm",
            &["fuyu-physics", "fuyu-ros", "nalgebra", "rustdds"],
        ),
        (
            "fuyu-lti",
            "nalgebra",
            &["fuyu-physics", "fuyu-ros", "ros2-client", "rustdds"],
        ),
        (
            "fuyu-render",
            "rayon",
            &["fuyu-physics", "fuyu-ros", "rustdds", "wgpu"],
        ),
        (
            "fuyu-track",
            "optical-flow-lk",
            &["fuyu-physics", "fuyu-ros", "fuyu-render", "rustdds"],
        ),
        (
            "fuyu-ros",
            "rustdds",
            &["fuyu-physics", "fuyu-lti", "fuyu-structures", "nalgebra"],
        ),
    ] {
        let dependencies = dependencies(package);
        assert!(dependencies.contains(needed), "{dependencies:?}");
        let wrong: Vec<_> = forbidden
            .iter()
            .filter(|name| dependencies.contains(**name))
            .collect();
        assert!(wrong.is_empty(), "{package} depends on {wrong:?}");
    }
}

#[test]
fn no_file_is_longer_than_600_lines() {
    let packages = PACKAGES
        .iter()
        .map(|(_, folder)| root().join(folder).join("src"));
    let others = ["tests", "benches", "examples"].map(|folder| root().join(folder));
    let folders = packages.chain(others).filter(|folder| folder.exists());
    let long: Vec<_> = folders
        .flat_map(|folder| rust_files(&folder))
        .map(|file| {
            (
                std::fs::read_to_string(&file).unwrap().lines().count(),
                file,
            )
        })
        .filter(|(lines, _)| *lines > 600)
        .collect();
    assert_eq!(long, []);
}
