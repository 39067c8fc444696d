//! Rendering thread, so that rendering does not delay poses and features.

use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
        mpsc::{Receiver, Sender, TryRecvError, channel},
    },
    thread,
};

use super::{
    imager::{Imager, Shot},
    outputs::{Content, ImageMessage, Output},
};
use crate::{
    msg::sensor_msgs::{CameraInfo, CompressedImage, Image},
    ros::{Node, NodeError, Publisher},
};

/// Maximum number of shots waiting for the thread; further shots are refused.
const MOST_WAITING: usize = 2;

/// A publisher of an output.
enum OutputPublisher {
    Image(Publisher<Image>),
    Compressed(Publisher<CompressedImage>),
    Info(Publisher<CameraInfo>),
}

impl OutputPublisher {
    fn new(node: &Node, output: &Output) -> Result<Self, NodeError> {
        let (topic, qos) = (output.topic.as_str(), output.qos);
        Ok(match output.content {
            Content::Image => Self::Image(node.advertise(topic, qos)?),
            Content::Compressed => Self::Compressed(node.advertise(topic, qos)?),
            Content::Info => Self::Info(node.advertise(topic, qos)?),
        })
    }

    fn publish(&self, message: &ImageMessage) {
        match (self, message) {
            (Self::Image(publisher), ImageMessage::Image(image)) => publisher.publish(image),
            (Self::Compressed(publisher), ImageMessage::Compressed(image)) => {
                publisher.publish(image);
            }
            (Self::Info(publisher), ImageMessage::Info(info)) => publisher.publish(info.as_ref()),
            _ => {}
        }
    }
}

enum Order {
    Render(Shot),
    /// Publish the oldest rendered images.
    Publish,
    /// Discard all rendered images.
    Clear,
}

/// Report on a rendered shot.
pub struct Rendered {
    /// Rendering time \[s\].
    pub duration: f64,
    /// A line for each camera that is inside a body.
    pub enclosed: Vec<String>,
}

/// The thread that renders and publishes images. Dropping it waits until its remaining work is done.
pub struct ImageThread {
    orders: Sender<Order>,
    reports: Receiver<Rendered>,
    waiting: Arc<AtomicUsize>,
    handle: Option<thread::JoinHandle<()>>,
}

impl ImageThread {
    /// Advertises the outputs, publishes the calibrations, and starts the thread.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn start(node: &Node, mut imager: Imager, outputs: &[Output]) -> Result<Self, NodeError> {
        let publishers = outputs.iter();
        let publishers = publishers.map(|output| OutputPublisher::new(node, output));
        let publishers: Vec<_> = publishers.collect::<Result<_, _>>()?;
        for (i, info) in imager.infos(0.0) {
            publishers[i].publish(&info);
        }
        let (orders, queue) = channel();
        let (done, reports) = channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let count = waiting.clone();
        let handle = thread::Builder::new()
            .name("images".to_owned())
            .spawn(move || {
                let mut rendered = VecDeque::new();
                for order in queue {
                    match order {
                        Order::Render(shot) => {
                            let start = std::time::Instant::now();
                            let enclosed = imager.enclosed(&shot);
                            rendered.push_back(imager.render(&shot));
                            count.fetch_sub(1, Ordering::Relaxed);
                            let duration = start.elapsed().as_secs_f64();
                            // Fails only if the node has ended.
                            let _ = done.send(Rendered { duration, enclosed });
                        }
                        Order::Publish => {
                            for (i, message) in rendered.pop_front().unwrap_or_default() {
                                publishers[i].publish(&message);
                            }
                        }
                        Order::Clear => rendered.clear(),
                    }
                }
            })
            .map_err(|e| NodeError::Input(format!("no thread can be started: {e}")))?;
        Ok(Self {
            orders,
            reports,
            waiting,
            handle: Some(handle),
        })
    }

    /// Whether the thread can take another shot.
    pub fn is_free(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) < MOST_WAITING
    }

    /// Renders a shot; its images are kept until [`Self::publish`].
    pub fn render(&self, shot: Shot) {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        // Fails only if the thread has panicked, which `report` reports.
        let _ = self.orders.send(Order::Render(shot));
    }

    /// Publishes the images of the oldest shot, once they are rendered.
    pub fn publish(&self) {
        let _ = self.orders.send(Order::Publish);
    }

    /// Discards rendered images that are not published yet.
    pub fn clear(&self) {
        let _ = self.orders.send(Order::Clear);
    }

    /// The next report on a rendered shot, if there is one.
    ///
    /// # Errors
    /// If the thread has panicked.
    pub fn report(&self) -> Result<Option<Rendered>, String> {
        match self.reports.try_recv() {
            Ok(rendered) => Ok(Some(rendered)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => {
                Err("the thread that renders has panicked".to_owned())
            }
        }
    }
}

impl Drop for ImageThread {
    fn drop(&mut self) {
        let (orders, _) = channel();
        self.orders = orders;
        if let Some(handle) = self.handle.take() {
            // A panic has been reported already.
            let _ = handle.join();
        }
    }
}
