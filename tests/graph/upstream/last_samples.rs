//! The last samples of a writer.

use fuyu::{
    msg::std_msgs::String as Text,
    ros::{DiscoveryRange, Domain, Process, Qos, RosArgs},
};
use std::sync::mpsc;

use super::*;

const DOMAIN: u16 = 70;

#[test]
fn samples_of_a_writer_that_has_left_are_lost() {
    let _claim = DomainClaim::new(DOMAIN);
    let (here, there) = (participant(DOMAIN), participant(DOMAIN));
    let mut reader = reader(&here);
    let writer = writer(&there);
    connect(&writer, &mut reader);
    writer.write(vec![0; 9], None).unwrap();
    let patience = Duration::from_secs(5);
    assert!(writer.wait_for_acknowledgments(patience).unwrap());
    drop(writer);
    // Until the reader knows that it has left.
    thread::sleep(SILENCE);
    assert_eq!(length(&mut reader, SILENCE), None);
}

// The subscriber takes the message a tenth of a second after it came.
#[test]
fn a_publisher_stays_until_its_last_message_is_taken() {
    let _claim = DomainClaim::new(DOMAIN);
    let here = participant(DOMAIN);
    let kind = "std_msgs::msg::dds_::String_".to_owned();
    let topic = here.create_topic("rt/last".into(), kind, &qos(), TopicKind::NoKey);
    let subscriber = here.create_subscriber(&qos()).unwrap();
    let reader = subscriber.create_datareader_no_key_cdr::<String>(&topic.unwrap(), None);
    let mut reader = reader.unwrap();
    let range = DiscoveryRange::Localhost;
    let domain = Domain { id: DOMAIN, range };
    let mut process = Process::new(RosArgs::default(), domain);
    let (say, published) = mpsc::channel();
    let (end, ends) = mpsc::channel();
    let program = move |node: &fuyu::ros::Node| {
        let publisher = node.advertise::<Text>("/last", Qos::RELIABLE)?;
        let text = |data: &str| Text { data: data.into() };
        while ends.try_recv().is_err() {
            publisher.publish(&text("not yet"));
            thread::sleep(Duration::from_millis(10));
        }
        publisher.publish(&text("last"));
        let _ = say.send(Instant::now());
        Ok(())
    };
    process.start("ending", program).unwrap();
    let mut take = || {
        let sample = reader.take_next_sample().ok().flatten();
        sample.map(|sample| sample.into_value())
    };
    eventually("the first message", PATIENCE, &mut take);
    end.send(()).unwrap();
    let at = published.recv_timeout(PATIENCE).expect("it publishes");
    let late = at + Duration::from_millis(100);
    thread::sleep(late.saturating_duration_since(Instant::now()));
    let last = std::iter::from_fn(take).last();
    assert_eq!(last.as_deref(), Some("last"));
    process.finish().unwrap();
}
