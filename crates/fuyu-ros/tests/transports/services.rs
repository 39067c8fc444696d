//! Services and parameters between two sessions.

use fuyu_ros::{
    msg::{
        rcl_interfaces::{
            Parameter, ParameterType, ParameterValue,
            services::{GetParameters, GetParametersRequest, SetParameters, SetParametersRequest},
        },
        std_srvs::{Trigger, TriggerRequest, TriggerResponse},
    },
    ros::{CallError, Node, NodeError},
};
use std::time::Duration;

use crate::{
    messages::{AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse},
    router::{Network, PATIENCE, eventually, idle},
};

// Fails if replies were lost, given to the wrong call, or limited in length.
#[test]
fn calls_get_their_replies() {
    Network::each(210, calls_get_their_replies_over);
}

fn calls_get_their_replies_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    let server = one.start("server", idle).expect("it starts");
    let client = two.start("client", idle).expect("it starts");
    let _sum = server
        .serve::<AddTwoInts>("sum", |r| AddTwoIntsResponse { sum: r.a + r.b })
        .expect("it serves");
    // Over DDS a lost fragment of a long reply is not repeated.
    let length = if network.is_zenoh() {
        3_000_000
    } else {
        30_000
    };
    let _long = server
        .serve::<Trigger>("long", move |_| TriggerResponse {
            success: true,
            message: "x".repeat(length),
        })
        .expect("it serves");
    let sum = client.client::<AddTwoInts>("sum").expect("a client");
    let calls: Vec<_> = (0..20)
        .map(|i| {
            assert!(sum.wait_for_service(PATIENCE));
            let request = AddTwoIntsRequest { a: i, b: 100 };
            (i, sum.send(&request).expect("it is sent"))
        })
        .collect();
    for (i, call) in calls {
        eventually("the reply arrives", || call.is_ready());
        assert_eq!(call.take().expect("it is ready").sum, i + 100);
    }
    let long = client.client::<Trigger>("long").expect("a client");
    let reply = long.call(&TriggerRequest::default(), PATIENCE);
    assert_eq!(reply.expect("it replies").message.len(), length);
    let missing = client.client::<Trigger>("missing").expect("a client");
    let error = missing.call(&TriggerRequest::default(), Duration::from_millis(100));
    assert!(matches!(error, Err(CallError::Timeout { .. })), "{error:?}");
}

// Fails if a client of a server in the same session and one elsewhere got each other's replies.
#[test]
fn a_service_is_called_from_its_own_and_from_another_session() {
    Network::each(
        212,
        a_service_is_called_from_its_own_and_from_another_session_over,
    );
}

fn a_service_is_called_from_its_own_and_from_another_session_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    let server = one.start("server", idle).expect("it starts");
    let near = one.start("near", idle).expect("it starts");
    let far = two.start("far", idle).expect("it starts");
    let _sum = server
        .serve::<AddTwoInts>("sum", |r| AddTwoIntsResponse { sum: r.a + r.b })
        .expect("it serves");
    let [near, far] = [near, far].map(|node| node.client::<AddTwoInts>("sum").expect("a client"));
    for i in 0..50 {
        for (client, b) in [(&near, 1), (&far, 2)] {
            let reply = client.call(&AddTwoIntsRequest { a: i, b }, PATIENCE);
            assert_eq!(reply.expect("it replies").sum, i + b);
        }
    }
}

fn with_gain(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let gain = declare.param("gain", 0.5, "A gain").live();
    declare.finish()?;
    while node.wait() {
        if gain.get() == 2.0 {
            return Ok(());
        }
    }
    Ok(())
}

// Fails if parameter services do not work over Zenoh: `ros2 param` uses them.
#[test]
fn parameters_are_read_and_set() {
    Network::each(214, parameters_are_read_and_set_over);
}

fn parameters_are_read_and_set_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    one.start("controlled", with_gain).expect("it starts");
    let client = two.start("client", idle).expect("it starts");
    let get = client.client::<GetParameters>("/controlled/get_parameters");
    let get = get.expect("a client");
    let names = vec!["gain".to_owned()];
    let mut value = 0.0;
    eventually("the parameter is declared", || {
        let request = GetParametersRequest {
            names: names.clone(),
        };
        let reply = get.call(&request, PATIENCE).expect("it replies");
        value = reply.values.first().map_or(0.0, |v| v.double_value);
        value != 0.0
    });
    assert_eq!(value, 0.5);
    let set = client.client::<SetParameters>("/controlled/set_parameters");
    let parameter = Parameter {
        name: "gain".to_owned(),
        value: ParameterValue {
            r#type: ParameterType::PARAMETER_DOUBLE,
            double_value: 2.0,
            ..ParameterValue::default()
        },
    };
    let request = SetParametersRequest {
        parameters: vec![parameter],
    };
    let reply = set.expect("a client").call(&request, PATIENCE);
    assert!(reply.expect("it replies").results[0].successful);
    // The program ends when it sees the new value.
    one.wait().expect("no failure");
}
