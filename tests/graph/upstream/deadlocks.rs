//! A deadlock of rustdds while endpoints are made.

use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
    thread::JoinHandle,
};

use super::*;

/// The topic that the crowd writes.
pub const TOPIC: &str = "crowd";
/// More than the 32 notices that wait in a participant at most.
const WRITERS: usize = 60;
/// Period of its announcements, at each of which participants read their database.
const NEWS: Duration = Duration::from_millis(1);
/// Participants here may have these ids; the next id's port receives their announcements.
const IDS: u16 = 8;
/// Where the number of a sample stands in the announcement of a participant, which is all there is in a datagram.
const NUMBER: std::ops::Range<usize> = 40..44;

/// Makes a deadlock likely when a participant makes readers of [`TOPIC`]: the topic has many writers, whose
/// participant announces itself all the time.
pub struct Crowd {
    pub writers: Vec<DataWriter<Vec<u8>>>,
    _participant: DomainParticipant,
    over: Arc<AtomicBool>,
    herald: Option<JoinHandle<()>>,
}

impl Crowd {
    pub fn new(domain: u16, type_name: &str) -> Self {
        let port = |id| (Ipv4Addr::LOCALHOST, 7400 + 250 * domain + 10 + 2 * id);
        let socket = UdpSocket::bind(port(IDS)).unwrap();
        let here = participant(domain);
        let name = format!("rt/{TOPIC}");
        let topic = here.create_topic(name, type_name.into(), &best_effort(), TopicKind::NoKey);
        let (topic, publisher) = (topic.unwrap(), here.create_publisher(&best_effort()));
        let publisher = publisher.unwrap();
        let writer = || {
            publisher
                .create_datawriter_no_key_cdr(&topic, None)
                .unwrap()
        };
        let writers = (0..WRITERS).map(|_| writer()).collect();
        let prefix = here.guid().prefix;
        let over = Arc::new(AtomicBool::new(false));
        let herald = thread::spawn({
            let over = Arc::clone(&over);
            let ports: Vec<_> = (0..IDS).map(port).collect();
            move || {
                let mut news = vec![0; 1 << 16];
                loop {
                    let length = socket.recv(&mut news).unwrap();
                    if length > 100 && news[8..20] == *prefix.as_ref() {
                        news.truncate(length);
                        break;
                    }
                }
                for number in 1_000_u32.. {
                    if over.load(Relaxed) {
                        return;
                    }
                    news[NUMBER].copy_from_slice(&number.to_le_bytes());
                    for port in &ports {
                        // The port may have no listener.
                        let _ = socket.send_to(&news, port);
                    }
                    thread::sleep(NEWS);
                }
            }
        });
        Self {
            writers,
            _participant: here,
            over,
            herald: Some(herald),
        }
    }

    /// Ends the announcements.
    pub fn calms_down(&mut self) {
        self.over.store(true, Relaxed);
        self.herald.take().map(JoinHandle::join);
    }
}

impl Drop for Crowd {
    fn drop(&mut self) {
        self.calms_down();
    }
}

fn best_effort() -> QosPolicies {
    QosPolicyBuilder::new()
        .reliability(Reliability::BestEffort)
        .history(History::KeepLast { depth: 10 })
        .build()
}

#[test]
fn a_participant_locks_itself_up() {
    const DOMAIN: u16 = 24;
    let _claim = DomainClaim::new(DOMAIN);
    let _crowd = Crowd::new(DOMAIN, "Bytes");
    let made = Arc::new(AtomicUsize::new(0));
    // Never ends.
    thread::spawn({
        let made = Arc::clone(&made);
        move || {
            let here = participant(DOMAIN);
            let name = format!("rt/{TOPIC}");
            let topic = here.create_topic(name, "Bytes".into(), &best_effort(), TopicKind::NoKey);
            let subscriber = here.create_subscriber(&best_effort()).unwrap();
            let mut readers: VecDeque<DataReader<Vec<u8>>> = VecDeque::new();
            loop {
                let reader = subscriber.create_datareader_no_key_cdr(topic.as_ref().unwrap(), None);
                readers.push_back(reader.unwrap());
                if readers.len() > 10 {
                    readers.pop_front();
                }
                made.fetch_add(1, Relaxed);
            }
        }
    });
    let (mut last, mut since) = (0, Instant::now());
    eventually("a reader that is never made", 3 * PATIENCE, || {
        let now = made.load(Relaxed);
        if now != last {
            (last, since) = (now, Instant::now());
        }
        (now > 0 && since.elapsed() > 2 * SILENCE).then_some(())
    });
    println!("{last} readers were made before it");
}
