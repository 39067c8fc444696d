//! Tests of the QoS inside a participant, without DDS.

use std::{
    sync::{Arc, Mutex, PoisonError, atomic::Ordering::Relaxed, mpsc},
    thread,
    time::Duration,
};

use super::*;
use crate::{
    msg::{cdr, std_msgs::String as Text},
    ros::{
        NodeName,
        endpoint::{Counters, Destination, Handler, Inbox},
        handler_queue::HandlerQueue,
        receive_queue::ReceiveQueue,
    },
};

fn node() -> Arc<NodeName> {
    Arc::new(NodeName::new("/", "node").unwrap())
}

fn spec(qos: Qos) -> EndpointSpec {
    EndpointSpec::topic::<Text>("/t", qos)
}

fn writer(topic: &Arc<LocalTopic>, qos: Qos) -> Arc<Writer> {
    let writer = Arc::new(Writer::new(spec(qos), node(), Arc::clone(topic)));
    topic.add_writer(&writer);
    writer
}

fn publish(writer: &Arc<Writer>, text: &str) -> usize {
    let message = Text { data: text.into() };
    let share = || -> AnyMessage { Arc::new(message.clone()) };
    let outgoing = Outgoing {
        cdr: cdr::encode(&message).into(),
        message: Some(&share),
        related: None,
        identity: None,
    };
    writer.local.deliver(writer, outgoing)
}

/// A subscription with a queue, as programs have it.
struct Listener {
    queue: Arc<ReceiveQueue<Text>>,
    reader: Arc<Reader>,
}

impl Listener {
    fn new(topic: &Arc<LocalTopic>, qos: Qos) -> Self {
        let queue = Arc::new(ReceiveQueue::new(&spec(qos), Arc::default()));
        let inbox = Destination::Inbox(Arc::clone(&queue) as Arc<dyn Inbox>);
        let reader = Arc::new(Reader::new(spec(qos), node(), inbox, Arc::clone(topic)));
        topic.add_reader(&reader);
        Self { queue, reader }
    }

    fn taken(&self) -> Vec<String> {
        let all = std::iter::from_fn(|| self.queue.take());
        all.map(|received| received.message.data).collect()
    }

    fn lost(&self) -> u64 {
        self.reader.counters.lost()
    }
}

fn numbers(range: std::ops::Range<usize>) -> Vec<String> {
    range.map(|n| n.to_string()).collect()
}

// Fails if a late program loses messages of a reliable subscription because of its depth.
#[test]
fn reliable_messages_wait_for_a_late_program() {
    let topic = Arc::default();
    let writer = writer(&topic, Qos::RELIABLE);
    let listener = Listener::new(&topic, Qos::RELIABLE.depth(10));
    for n in 0..4096 {
        publish(&writer, &n.to_string());
    }
    assert_eq!(listener.lost(), 0);
    // The memory is limited; lost messages are counted.
    for n in 4096..5000 {
        publish(&writer, &n.to_string());
    }
    assert_eq!(listener.lost(), 904);
    assert_eq!(listener.taken(), numbers(904..5000));
}

#[test]
fn best_effort_messages_beyond_the_depth_replace_the_oldest() {
    let topic = Arc::default();
    let writer = writer(&topic, Qos::RELIABLE);
    let listener = Listener::new(&topic, Qos::SENSOR_DATA.depth(3));
    for n in 0..10 {
        publish(&writer, &n.to_string());
    }
    assert_eq!(listener.taken(), numbers(7..10));
    assert_eq!(listener.lost(), 7);
}

#[test]
fn only_the_newest_is_in_a_queue_of_depth_one() {
    let topic = Arc::default();
    let writer = writer(&topic, Qos::CLOCK);
    let listener = Listener::new(&topic, Qos::CLOCK);
    for n in 0..10 {
        publish(&writer, &n.to_string());
    }
    assert_eq!(listener.taken(), ["9"]);
    assert_eq!(listener.lost(), 0, "replaced as intended");
}

#[test]
fn late_joiners_get_what_a_transient_local_publisher_keeps() {
    let topic = Arc::default();
    let kept = writer(&topic, Qos::LATCHED.depth(2));
    for n in 0..5 {
        publish(&kept, &n.to_string());
    }
    let late = Listener::new(&topic, Qos::LATCHED.depth(10));
    let volatile = Listener::new(&topic, Qos::RELIABLE);
    publish(&kept, "5");
    assert_eq!(late.taken(), ["3", "4", "5"]);
    assert_eq!(volatile.taken(), ["5"]);
    // A publisher that has left retains no messages.
    topic.remove_writer(&kept);
    assert!(Listener::new(&topic, Qos::LATCHED).taken().is_empty());
}

#[test]
fn what_is_older_than_the_lifespan_is_not_kept() {
    let topic = Arc::default();
    let lifespan = Some(Duration::from_millis(20));
    let writer = writer(
        &topic,
        Qos {
            lifespan,
            ..Qos::LATCHED
        },
    );
    publish(&writer, "old");
    thread::sleep(Duration::from_millis(40));
    assert!(Listener::new(&topic, Qos::LATCHED).taken().is_empty());
}

// Fails if a joining subscription gets a message twice (retained and live), or misses one in between.
#[test]
fn a_subscription_that_joins_meanwhile_misses_and_repeats_nothing() {
    let topic: Arc<LocalTopic> = Arc::default();
    let qos = Qos::LATCHED.depth(4000);
    let writer = writer(&topic, qos);
    let publisher = thread::spawn(move || {
        for n in 0..4000 {
            publish(&writer, &n.to_string());
        }
    });
    let listeners: Vec<_> = (0..20).map(|_| Listener::new(&topic, qos)).collect();
    publisher.join().unwrap();
    for listener in listeners {
        assert!(listener.taken() == numbers(0..4000));
    }
}

#[test]
fn all_subscriptions_get_the_messages_of_two_publishers_in_one_order() {
    let topic: Arc<LocalTopic> = Arc::default();
    let listeners: Vec<_> = (0..4)
        .map(|_| Listener::new(&topic, Qos::RELIABLE))
        .collect();
    let publishers: Vec<_> = ["a", "b"]
        .into_iter()
        .map(|name| {
            let writer = writer(&topic, Qos::RELIABLE);
            thread::spawn(move || {
                for n in 0..1000 {
                    assert_eq!(publish(&writer, &format!("{name}{n}")), 4);
                }
            })
        })
        .collect();
    publishers.into_iter().for_each(|p| p.join().unwrap());
    let first = listeners[0].taken();
    assert_eq!(first.len(), 2000);
    for name in ["a", "b"] {
        let of_one: Vec<_> = first.iter().filter(|text| text.starts_with(name)).collect();
        let expected: Vec<_> = (0..1000).map(|n| format!("{name}{n}")).collect();
        assert!(of_one.into_iter().eq(&expected));
    }
    for other in &listeners[1..] {
        assert!(other.taken() == first);
    }
}

#[test]
fn nothing_arrives_after_a_subscription_has_ended() {
    let topic: Arc<LocalTopic> = Arc::default();
    let writer = writer(&topic, Qos::RELIABLE);
    let (stay, go) = (
        Listener::new(&topic, Qos::RELIABLE),
        Listener::new(&topic, Qos::RELIABLE),
    );
    assert_eq!(writer.counters.matched(), 2);
    let (published, wait) = mpsc::channel();
    let publisher = thread::spawn({
        let writer = Arc::clone(&writer);
        move || {
            for n in 0..2000 {
                publish(&writer, &n.to_string());
                if n == 100 {
                    published.send(()).unwrap();
                }
            }
        }
    });
    wait.recv().unwrap();
    topic.remove_reader(&go.reader);
    let count = go.taken().len();
    publisher.join().unwrap();
    assert!(go.taken().is_empty(), "after the first {count}");
    assert!(stay.taken() == numbers(0..2000));
    assert_eq!(writer.counters.matched(), 1);
    topic.remove_reader(&go.reader);
    assert_eq!(writer.counters.matched(), 1, "removed twice");
}

#[test]
fn endpoints_are_matched_by_type_and_quality_of_service() {
    let topic: Arc<LocalTopic> = Arc::default();
    let writer = writer(&topic, Qos::SENSOR_DATA);
    let join = |spec: EndpointSpec| {
        let queue: Arc<ReceiveQueue<Text>> = Arc::new(ReceiveQueue::new(&spec, Arc::default()));
        let inbox = Destination::Inbox(queue);
        let reader = Arc::new(Reader::new(spec, node(), inbox, Arc::clone(&topic)));
        topic.add_reader(&reader)
    };
    assert!(join(spec(Qos::SENSOR_DATA)).is_empty());
    for qos in [Qos::RELIABLE, Qos::LATCHED] {
        assert!(matches!(&join(spec(qos))[..], [Mismatch::Qos(_)]));
    }
    let dds_type = "std_msgs::msg::dds_::Int32_".to_owned();
    let other = EndpointSpec {
        dds_type,
        ..spec(Qos::SENSOR_DATA)
    };
    assert!(matches!(&join(other)[..], [Mismatch::Types(..)]));
    assert_eq!(publish(&writer, "to one"), 1);
    let deadline = |ms| Some(Duration::from_millis(ms));
    let with = |deadline| Qos {
        deadline,
        ..Qos::RELIABLE
    };
    assert!(satisfies(&with(deadline(10)), &with(deadline(20))));
    assert!(satisfies(&with(deadline(10)), &with(None)));
    assert!(!satisfies(&with(deadline(20)), &with(deadline(10))));
    assert!(!satisfies(&with(None), &with(deadline(10))));
}

/// Stores all samples.
#[derive(Default)]
struct Collector(Mutex<Vec<LocalSample>>);

impl Inbox for Collector {
    fn accept(&self, sample: LocalSample, _: Origin, _: &Counters) -> bool {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(sample);
        true
    }
}

// Fails if each subscription gets a copy, or if the bytes are serialized for each.
#[test]
fn subscriptions_share_one_message_and_its_bytes() {
    let topic: Arc<LocalTopic> = Arc::default();
    let writer = writer(&topic, Qos::RELIABLE);
    let collectors: Vec<Arc<Collector>> = vec![Arc::default(), Arc::default()];
    for collector in &collectors {
        let inbox = Destination::Inbox(Arc::clone(collector) as Arc<dyn Inbox>);
        let reader = Reader::new(spec(Qos::RELIABLE), node(), inbox, Arc::clone(&topic));
        topic.add_reader(&Arc::new(reader));
    }
    publish(&writer, "hello");
    let samples: Vec<_> = collectors
        .iter()
        .map(|c| c.0.lock().unwrap_or_else(PoisonError::into_inner)[0].clone())
        .collect();
    let messages: Vec<_> = samples
        .iter()
        .map(|s| s.message.clone().unwrap().downcast::<Text>().unwrap())
        .collect();
    assert_eq!(messages[0].data, "hello");
    assert!(Arc::ptr_eq(&messages[0], &messages[1]));
    assert_eq!(samples[0].raw.cdr.as_ptr(), samples[1].raw.cdr.as_ptr());
}

/// A handler that waits for a permission before each sample.
fn slow_handler(
    topic: &Arc<LocalTopic>,
    qos: Qos,
) -> (
    Arc<Reader>,
    Arc<HandlerQueue>,
    mpsc::Sender<()>,
    mpsc::Receiver<i64>,
) {
    let queue: Arc<HandlerQueue> = Arc::default();
    let (permit, permits) = mpsc::channel();
    let (handled, all) = mpsc::channel();
    let permits = Mutex::new(permits);
    let sink = move |sample: RawSample, _: &Counters| {
        let permits = permits.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = permits.recv();
        handled.send(sample.sequence_number).is_ok()
    };
    let destination = Destination::Handler(Handler {
        sink: Box::new(sink),
        patience: Duration::ZERO,
        queue: Arc::clone(&queue),
    });
    let reader = Reader::new(spec(qos), node(), destination, Arc::clone(topic));
    let reader = Arc::new(reader);
    topic.add_reader(&reader);
    let running = Arc::clone(&queue);
    thread::spawn(move || running.run(|_, _, _| {}));
    (reader, queue, permit, all)
}

// Fails if a handler runs in the publishing thread, or if a reliable subscription loses messages meanwhile.
#[test]
fn a_slow_handler_delays_no_publisher_and_loses_nothing() {
    let topic: Arc<LocalTopic> = Arc::default();
    let writer = writer(&topic, Qos::RELIABLE);
    let (reader, queue, permit, all) = slow_handler(&topic, Qos::RELIABLE);
    for _ in 0..1000 {
        publish(&writer, "now");
    }
    assert!(all.try_recv().is_err());
    (0..1000).for_each(|_| permit.send(()).unwrap());
    topic.remove_reader(&reader);
    queue.flush(&reader, Duration::from_secs(60));
    assert!(all.try_iter().eq(1..=1000));
    assert_eq!(reader.counters.lost(), 0);
    queue.close();
}

#[test]
fn a_best_effort_handler_gets_the_newest() {
    let topic: Arc<LocalTopic> = Arc::default();
    let writer = writer(&topic, Qos::RELIABLE);
    let (reader, queue, permit, all) = slow_handler(&topic, Qos::SENSOR_DATA.depth(3));
    publish(&writer, "taken at once");
    permit.send(()).unwrap();
    assert_eq!(all.recv(), Ok(1));
    for _ in 0..100 {
        publish(&writer, "now");
    }
    drop(permit);
    queue.flush(&reader, Duration::from_secs(60));
    let got: Vec<_> = all.try_iter().collect();
    // The handler may have held one more message.
    assert!(got.ends_with(&[99, 100, 101]) && got.len() <= 4, "{got:?}");
    let lost = reader.counters.dropped.load(Relaxed);
    assert_eq!(lost + got.len() as u64, 100);
    queue.close();
}
