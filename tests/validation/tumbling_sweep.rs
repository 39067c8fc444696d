//! trial
use fuyu::estimation::MotionModel;
use fuyu::estimation::sweep::*;

fn run(name: &str, condition: Condition, table: &ModelTable) {
    let motions: Vec<_> = grid(0.8).iter().map(|m| m.rotation().unwrap()).collect();
    let start = std::time::Instant::now();
    let cells = in_parallel(&motions, 2, |m| cell(m, condition));
    let took = start.elapsed();
    let models: Vec<_> = cells.iter().map(|c| c.model).collect();
    let agree = table.agreement(&models);
    let ok: Vec<_> = cells
        .iter()
        .filter(|c| c.model == Some(MotionModel::Asymmetric))
        .filter_map(|c| c.result.as_ref().ok())
        .collect();
    let refused = cells.iter().filter(|c| c.result.is_err()).count();
    let refused_asym = cells
        .iter()
        .filter(|c| c.model == Some(MotionModel::Asymmetric) && c.result.is_err())
        .count();
    let mut r: Vec<_> = ok.iter().map(|c| c.parameters).collect();
    let mut phi: Vec<_> = ok.iter().map(|c| c.prediction.axis.to_degrees()).collect();
    r.sort_by(f64::total_cmp);
    phi.sort_by(f64::total_cmp);
    println!(
        "{name} {}: {agree} {:.2}%  asym {} r {:.2e}/{:.2e} phi {:.3}/{:.2} refused {refused} ({refused_asym} asym) {took:?}",
        table.number,
        agree as f64 / 2.94,
        r.len(),
        r[r.len() / 2],
        r[r.len() - 1],
        phi[phi.len() / 2],
        phi[phi.len() - 1]
    );
    if std::env::var("SHOW").is_ok() {
        for s in (0..21).rev() {
            let row: String = (0..14)
                .map(|e| {
                    let c = &cells[e * 21 + s];
                    match c.model {
                        Some(MotionModel::Asymmetric) => 'O',
                        Some(MotionModel::Axisymmetric) => 'v',
                        _ => '/',
                    }
                })
                .collect();
            let row2: String = (0..14)
                .map(|e| {
                    let c = &cells[e * 21 + s];
                    if c.model == Some(table.model(e, s)) {
                        '.'
                    } else {
                        'x'
                    }
                })
                .collect();
            println!("{row} {row2}");
        }
    }
}
#[test]
fn trial() {
    run("w", Condition::TrueRates, &TABLE_3_2);
    run("R", Condition::TrueRotations, &TABLE_3_3);
    let data: serde_json::Value =
        serde_json::from_str(include_str!("fixtures/e050_s+03_r1024.json")).unwrap();
    let verts: Vec<_> = crate::fixtures::rows(&data["points_body_mm"])
        .iter()
        .map(|p| nalgebra::Vector3::from_row_slice(p) * 1e-3)
        .collect();
    let pts = fuyu::vision::BodyPoint::of_vertices(&verts);
    for (r, t) in [(1024, &TABLE_3_5), (512, &TABLE_3_6), (256, &TABLE_3_7)] {
        run(
            "fix",
            Condition::Images {
                resolution: r,
                points: &pts,
            },
            t,
        );
    }
}
