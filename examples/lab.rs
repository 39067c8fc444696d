use fuyu::dynamics::*;
use fuyu::model::*;
use fuyu::spatial::*;
use nalgebra::*;
use std::hint::black_box;
use std::time::Instant;
fn chain(links: usize) -> Model {
    let body = |mass: f64| RigidInertia {
        mass,
        com: Vector3::new(0.2, 0.01, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.02, 0.15, 0.15)) * mass,
    };
    let mut builder = ModelBuilder::new("chain", "base_link", body(1000.0));
    let mut parent = 0;
    for k in 0..links {
        let placement = Pose::from_parts(
            Translation3::new(0.4, 0.0, 0.0),
            Rotation3::from_euler_angles(1.2, 0.1, 0.3),
        );
        parent = builder.body(
            &format!("link{k}"),
            parent,
            JointKind::Continuous,
            Vector3::z_axis(),
            placement,
            body(5.0),
        );
    }
    builder.build()
}
fn main() {
    let mode = std::env::args().nth(1).unwrap_or("all".into());
    let count: usize = std::env::args()
        .nth(2)
        .map_or(100000, |s| s.parse().unwrap());
    let servicer = Model::from_urdf(include_str!("../urdf/servicer.urdf"), "servicer").unwrap();
    let only = std::env::args().nth(3).unwrap_or_default();
    for (name, model) in [
        ("servicer", servicer),
        ("chain6", chain(6)),
        ("chain30", chain(30)),
    ] {
        if !only.is_empty() && only != name {
            continue;
        }
        let n = model.dof();
        let q: Vec<f64> = (0..n).map(|j| 0.3 + 0.7 * (j as f64).sin()).collect();
        let qd: Vec<f64> = (0..n).map(|j| 0.5 * (1.0 + j as f64).cos()).collect();
        let qs = [q.clone(), q.iter().map(|x| x * 1.01).collect()];
        let mut input = Input::zero(&model);
        input.efforts.fill(0.3);
        let V = Twist::new(Vector3::new(0.1, -0.2, 0.05), Vector3::new(0.3, 0.1, 0.2));
        let states: Vec<State> = qs
            .iter()
            .map(|q| {
                let mut s = State::at_rest_with(&model, &DVector::from_row_slice(q));
                s.qd = DVector::from_row_slice(&qd);
                s.momentum_W.angular = Vector3::new(20.0, -35.0, 12.0);
                s
            })
            .collect();
        let mut out = TreeAcceleration::zero(&model);
        let mut qdd = DVector::zeros(n);
        let mut ws = Workspace::new(&model);
        let tip = model.frames().last().unwrap().clone();
        let mut jac = Matrix6xX::zeros(n);
        let mut aba = FormulationKind::ArticulatedBody.prepare(&model);
        let mut integrator = Integrator::new(&model, Method::Rk4);
        let mut st = states[0].clone();
        let mut coast = |_: f64, _: &State, _: &mut Input| {};
        let mut run = |what: &str, f: &mut dyn FnMut(usize)| {
            if mode != "all" && mode != what {
                return;
            }
            for i in 0..100 {
                f(i & 1);
            }
            let mut best = f64::MAX;
            for _ in 0..20 {
                let t = Instant::now();
                for i in 0..count / 20 {
                    f(i & 1);
                }
                best = best.min(t.elapsed().as_secs_f64() / (count / 20) as f64);
            }
            println!("{name} {what} {:.1} ns", best * 1e9);
        };
        run("reduced", &mut |i| {
            ws.set_positions(&model, &states[i].q);
            ws.set_motion(&states[i]);
            ws.accelerations(&model, &states[i], &input, &mut qdd);
            black_box(&qdd);
        });
        run("aba", &mut |i| {
            aba.accelerations(
                &model,
                &TreeMotion {
                    R_WB: UnitQuaternion::identity(),
                    V_WB_B: V,
                    q: &qs[i],
                    qd: &qd,
                },
                &input,
                &mut out,
            );
            black_box(&out);
        });
        run("gjm", &mut |i| {
            ws.set_positions(&model, &states[i].q);
            ws.generalized_jacobian(&tip, &mut jac);
            black_box(&jac);
        });
        run("rk4", &mut |_| {
            integrator.step(&model, &mut st, &mut ws, 1e-3, &mut coast);
            black_box(&st);
        });
    }
}
