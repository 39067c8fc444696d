//! Services and parameters between two sessions.

use fuyu_ros::{
    msg::{
        cdr,
        rcl_interfaces::{
            Parameter, ParameterType, ParameterValue,
            services::{GetParameters, GetParametersRequest, SetParameters, SetParametersRequest},
        },
        std_srvs::{Trigger, TriggerRequest, TriggerResponse},
    },
    ros::{CallError, Node, NodeError},
};
use std::{
    sync::{
        Arc, Mutex,
        atomic::{AtomicUsize, Ordering::SeqCst},
    },
    time::Duration,
};
use zenoh::{Wait, query::QueryTarget};

use crate::{
    messages::{AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse},
    router::{Network, PATIENCE, Router, eventually, idle},
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

/// Key expressions of the services `sum` and `other`, of any type.
const SUM: &str = "0/sum/*/*";
const OTHER: &str = "0/other/*/*";

/// A server that speaks Zenoh only. It ends the first `ended` queries of the service without a reply, and answers 3 to the
/// others. Returns the attachments of all queries.
fn raw_server(
    session: &zenoh::Session,
    key: &'static str,
    ended: usize,
) -> Arc<Mutex<Vec<Vec<u8>>>> {
    let attachments = Arc::new(Mutex::new(Vec::new()));
    let arrived = Arc::clone(&attachments);
    let queryable = session.declare_queryable(key).complete(true);
    let queryable = queryable.callback(move |query| {
        let attachment = query.attachment().expect("it has one").to_bytes().to_vec();
        let mut arrived = arrived.lock().unwrap();
        arrived.push(attachment.clone());
        if arrived.len() > ended {
            let reply = cdr::encode(&AddTwoIntsResponse { sum: 3 });
            let reply = query.reply(query.key_expr(), reply);
            reply.attachment(attachment).wait().expect("it replies");
        }
    });
    // It lives as long as the session.
    queryable.background().wait().expect("it serves");
    // Until the queryable is known everywhere.
    std::thread::sleep(Duration::from_millis(500));
    attachments
}

// Fails if a request were lost whose query ends without a reply: while the routes between two peers change, a query does not
// reach the server. The server here ends the first query as such a change does.
#[test]
fn a_request_whose_query_ends_is_sent_again() {
    let router = Router::start();
    let server = router.client();
    let mut process = router.process(0);
    let client = process.start("client", idle).expect("it starts");
    let sum = client.client::<AddTwoInts>("sum").expect("a client");
    let attachments = raw_server(&server, SUM, 1);
    let request = AddTwoIntsRequest { a: 1, b: 2 };
    let call = sum.send(&request).expect("it is sent");
    eventually("the reply arrives", || call.is_ready());
    assert_eq!(call.take().expect("it is ready").sum, 3);
    let attachments = attachments.lock().unwrap();
    assert_eq!(attachments.len(), 2);
    assert_eq!(attachments[0], attachments[1]);
}

// Fails if a request that no server answers were sent for ever.
#[test]
fn a_request_is_sent_six_times_at_most() {
    let router = Router::start();
    let server = router.client();
    let mut process = router.process(0);
    let client = process.start("client", idle).expect("it starts");
    let sum = client.client::<AddTwoInts>("sum").expect("a client");
    let attachments = raw_server(&server, SUM, usize::MAX);
    let request = AddTwoIntsRequest { a: 1, b: 2 };
    let call = sum.send(&request).expect("it is sent");
    eventually("it is sent six times", || {
        attachments.lock().unwrap().len() == 6
    });
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(attachments.lock().unwrap().len(), 6);
    assert!(!call.is_ready());
}

// Fails if a request that a server in the same process answers were sent to a server elsewhere that comes later.
#[test]
fn a_request_to_a_server_of_the_same_process_is_not_sent_again() {
    let router = Router::start();
    let elsewhere = router.client();
    let mut process = router.process(0);
    let server = process.start("server", idle).expect("it starts");
    let client = process.start("client", idle).expect("it starts");
    let _sum = server
        .serve::<AddTwoInts>("sum", |r| AddTwoIntsResponse { sum: r.a + r.b })
        .expect("it serves");
    raw_server(&elsewhere, OTHER, 0);
    let [sum, other] = ["sum", "other"].map(|service| client.client::<AddTwoInts>(service));
    let (sum, other) = (sum.expect("a client"), other.expect("a client"));
    let request = AddTwoIntsRequest { a: 1, b: 2 };
    let reply = sum.call(&request, PATIENCE).expect("it replies");
    assert_eq!(reply.sum, 3);
    // The router takes the messages of a session in order: after this reply, the first attempt has ended there.
    let call = other.send(&request).expect("it is sent");
    eventually("the reply arrives", || call.is_ready());
    // It is there before the last attempt would be, and waits for it.
    let attachments = raw_server(&elsewhere, SUM, 0);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(attachments.lock().unwrap().len(), 0);
}

// Fails if a server served a request again that it has served, did not repeat its reply, took requests with other times for
// one and the same, or took a request to an earlier server for one to itself.
#[test]
fn a_request_that_arrives_twice_is_served_once() {
    let router = Router::start();
    let mut process = router.process(0);
    let server = process.start("server", idle).expect("it starts");
    let served = Arc::new(AtomicUsize::new(0));
    let serve = || {
        let counter = Arc::clone(&served);
        let serves = server.serve::<AddTwoInts>("sum", move |r| {
            counter.fetch_add(1, SeqCst);
            AddTwoIntsResponse { sum: r.a + r.b }
        });
        serves.expect("it serves")
    };
    let sum = serve();
    let client = router.client();
    let ask = |time: u8| {
        // Request 1 of a publisher, at this time: two 64-bit integers and a GID after its length.
        let mut attachment = [0_u8; 33];
        (attachment[0], attachment[8], attachment[16]) = (1, time, 16);
        let query = client.get(SUM).target(QueryTarget::All);
        let query = query.payload(cdr::encode(&AddTwoIntsRequest { a: 1, b: 2 }));
        let replies = query.attachment(attachment).wait().expect("it is sent");
        let replies = replies.iter().filter(|reply| reply.result().is_ok());
        replies.count()
    };
    eventually("the service is there", || ask(1) == 1);
    assert_eq!(served.load(SeqCst), 1);
    assert_eq!((ask(1), served.load(SeqCst)), (1, 1));
    assert_eq!((ask(2), served.load(SeqCst)), (1, 2));
    drop(sum);
    let _sum = serve();
    eventually("the new server is there", || ask(2) == 1);
    assert_eq!(served.load(SeqCst), 3);
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
