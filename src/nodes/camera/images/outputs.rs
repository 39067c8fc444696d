//! Messages of rendered images, and their topics.

use fuyu_render::{Frame, Sensor, encode};

use super::params::{CameraSpec, Colour, Compression, Depth};
use crate::{
    msg::{
        sensor_msgs::{CameraInfo, CompressedImage, Image},
        std_msgs::Header,
    },
    nodes::topics,
    ros::{Qos, Time},
};

/// A message of a camera.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageMessage {
    /// An image.
    Image(Image),
    /// A compressed image.
    Compressed(CompressedImage),
    /// The calibration.
    Info(Box<CameraInfo>),
}

/// Message type of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// `sensor_msgs/Image`.
    Image,
    /// `sensor_msgs/CompressedImage`.
    Compressed,
    /// `sensor_msgs/CameraInfo`.
    Info,
}

/// An output topic of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// Its name, relative to the node's namespace.
    pub topic: String,
    /// Its message type.
    pub content: Content,
    /// Its quality of service.
    pub qos: Qos,
}

/// Side of a stereo camera; a single camera is the left one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// At the link's frame.
    Left,
    /// Displaced to the right by the baseline.
    Right,
}

/// The topics of a camera; indices returned by [`messages`] and [`infos`] refer to this order.
pub fn outputs(spec: &CameraSpec) -> Vec<Output> {
    let name = &spec.name;
    let mut all = Vec::new();
    let mut add = |topic: String, content: Content| {
        let qos = match content {
            Content::Info => Qos::LATCHED,
            Content::Image | Content::Compressed => Qos::SENSOR_DATA,
        };
        all.push(Output {
            topic,
            content,
            qos,
        });
    };
    let is_compressed = spec.compressed != Compression::None;
    add(topics::CAMERA_INFO.of_camera(name), Content::Info);
    add(topics::IMAGE.of_camera(name), Content::Image);
    if is_compressed {
        add(
            topics::COMPRESSED_IMAGE.of_camera(name),
            Content::Compressed,
        );
    }
    if spec.depth != Depth::None {
        add(topics::DEPTH.of_camera(name), Content::Image);
    }
    if spec.segmentation {
        add(topics::SEGMENTATION.of_camera(name), Content::Image);
    }
    if spec.baseline > 0.0 {
        add(topics::LEFT_CAMERA_INFO.of_camera(name), Content::Info);
        add(topics::LEFT_IMAGE.of_camera(name), Content::Image);
        if is_compressed {
            add(
                topics::LEFT_COMPRESSED_IMAGE.of_camera(name),
                Content::Compressed,
            );
        }
        add(topics::RIGHT_CAMERA_INFO.of_camera(name), Content::Info);
        add(topics::RIGHT_IMAGE.of_camera(name), Content::Image);
        if is_compressed {
            add(
                topics::RIGHT_COMPRESSED_IMAGE.of_camera(name),
                Content::Compressed,
            );
        }
    }
    all
}

/// The calibration of a camera. `offset` is its position in the frame of its pair's left camera, along x \[m\].
///
/// The images of a pair are not rectified, but their axes are parallel and their calibrations equal: after removal of
/// the distortion, P describes them.
fn info(spec: &CameraSpec, header: Header, offset: f64) -> CameraInfo {
    let k = &spec.intrinsics;
    let (model, d) = spec.distortion.model();
    CameraInfo {
        header,
        height: k.height,
        width: k.width,
        distortion_model: model.to_owned(),
        d,
        k: [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [
            k.fx,
            0.0,
            k.cx,
            -k.fx * offset,
            0.0,
            k.fy,
            k.cy,
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
        ],
        ..CameraInfo::default()
    }
}

fn header(spec: &CameraSpec, time: f64) -> Header {
    Header {
        stamp: Time::from_secs_f64(time).into(),
        frame_id: spec.link.clone(),
    }
}

/// The calibrations of a camera at `time` \[s\], with the indices of their outputs.
pub fn infos(spec: &CameraSpec, time: f64) -> Vec<(usize, ImageMessage)> {
    let outputs = outputs(spec);
    let calibrations = outputs.iter().enumerate();
    let calibrations = calibrations.filter(|(_, output)| output.content == Content::Info);
    let messages = calibrations.map(|(i, output)| {
        let is_right = output.topic.ends_with("/right/camera_info");
        let offset = if is_right { spec.baseline } else { 0.0 };
        (
            i,
            ImageMessage::Info(Box::new(info(spec, header(spec, time), offset))),
        )
    });
    messages.collect()
}

/// The messages of a `frame` of one side of a camera, exposed at `time` \[s\], with the indices of their outputs.
/// `number` makes the noise of frames independent.
pub fn messages(
    spec: &CameraSpec,
    side: Side,
    time: f64,
    frame: &Frame,
    sensor: &Sensor,
    number: u64,
) -> Vec<(usize, ImageMessage)> {
    let (encoding, channels, pixels) = match spec.colour {
        Colour::Mono8 => ("mono8", 1, sensor.mono8(frame, number)),
        Colour::Rgb8 => ("rgb8", 3, sensor.rgb8(frame, number)),
    };
    let (width, height) = (spec.intrinsics.width, spec.intrinsics.height);
    let header = header(spec, time);
    let compressed = match spec.compressed {
        Compression::None => None,
        Compression::Png => Some(("png", encode::png(&pixels, width, height, channels))),
        Compression::Jpeg => {
            let quality = spec.jpeg_quality;
            let bytes = encode::jpeg(&pixels, width, height, channels, quality);
            Some(("jpeg", bytes))
        }
    };
    // The size matches the frame, so that compression cannot fail.
    let compressed = compressed.and_then(|(format, bytes)| {
        Some(CompressedImage {
            header: header.clone(),
            // The format string as written by image_transport.
            format: format!("{encoding}; {format} compressed {}", decoded(encoding)),
            data: bytes.ok()?,
        })
    });
    let image = |encoding: &str, bytes_per_pixel: u32, data: Vec<u8>| {
        ImageMessage::Image(Image {
            header: header.clone(),
            height,
            width,
            encoding: encoding.to_owned(),
            is_bigendian: 0,
            step: width * bytes_per_pixel,
            data,
        })
    };
    let mut messages = Vec::new();
    let raw = image(encoding, channels, pixels);
    for (i, output) in outputs(spec).iter().enumerate() {
        let is_right = output.topic.contains("/right/");
        if is_right != (side == Side::Right) {
            continue;
        }
        let name = output.topic.rsplit('/').next().unwrap_or_default();
        let message = match (output.content, name) {
            (Content::Info, _) => continue,
            (Content::Compressed, _) => match &compressed {
                Some(compressed) => ImageMessage::Compressed(compressed.clone()),
                None => continue,
            },
            (Content::Image, "depth") => match spec.depth {
                Depth::Millimetres => image(spec.depth.name(), 2, frame.depth_16uc1()),
                _ => image(spec.depth.name(), 4, frame.depth_32fc1()),
            },
            (Content::Image, "segmentation") => image("16UC1", 2, frame.ids_16uc1()),
            (Content::Image, _) => raw.clone(),
        };
        messages.push((i, message));
    }
    messages
}

/// The encoding after decompression, as named by `compressed_image_transport`: OpenCV decodes colours as BGR, and
/// readers convert them only if the format string says so.
fn decoded(encoding: &str) -> &'static str {
    if encoding == "mono8" { "mono8" } else { "bgr8" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fuyu_render::{Distortion, Intrinsics};

    fn stereo() -> CameraSpec {
        CameraSpec {
            name: "wrist".to_owned(),
            link: "tool0".to_owned(),
            intrinsics: Intrinsics::centred(32, 16, 20.0),
            distortion: Distortion::Equidistant([0.1, 0.0, 0.0, 0.0]),
            colour: Colour::Rgb8,
            compressed: Compression::Png,
            jpeg_quality: 90,
            depth: Depth::Millimetres,
            segmentation: true,
            baseline: 0.2,
        }
    }

    #[test]
    fn every_output_gets_one_message_of_a_pair() {
        let spec = stereo();
        let outputs = outputs(&spec);
        let frame = Frame {
            width: 32,
            height: 16,
            radiance: vec![[0.5; 3]; 512],
            depth: vec![2.0; 512],
            ids: vec![3; 512],
        };
        let sensor = Sensor::default();
        let mut found = infos(&spec, 1.5);
        found.extend(messages(&spec, Side::Left, 1.5, &frame, &sensor, 0));
        found.extend(messages(&spec, Side::Right, 1.5, &frame, &sensor, 1));
        found.sort_by_key(|(i, _)| *i);
        let indices: Vec<_> = found.iter().map(|(i, _)| *i).collect();
        assert_eq!(indices, (0..outputs.len()).collect::<Vec<_>>());
        let topics: Vec<_> = outputs.iter().map(|o| o.topic.as_str()).collect();
        assert_eq!(
            topics,
            [
                "wrist/camera_info",
                "wrist/image_raw",
                "wrist/image_raw/compressed",
                "wrist/depth",
                "wrist/segmentation",
                "wrist/left/camera_info",
                "wrist/left/image_raw",
                "wrist/left/image_raw/compressed",
                "wrist/right/camera_info",
                "wrist/right/image_raw",
                "wrist/right/image_raw/compressed",
            ]
        );
        for ((_, message), output) in found.iter().zip(&outputs) {
            let content = match message {
                ImageMessage::Image(image) => {
                    assert_eq!(image.data.len() as u32, image.step * image.height);
                    assert_eq!(image.header.frame_id, "tool0");
                    Content::Image
                }
                ImageMessage::Compressed(image) => {
                    assert!(image.format.contains("png"));
                    Content::Compressed
                }
                ImageMessage::Info(info) => {
                    assert_eq!(info.distortion_model, "equidistant");
                    // Tx of a stereo pair is -fx times the baseline.
                    let right = output.topic.contains("right");
                    assert_eq!(info.p[3], if right { -4.0 } else { 0.0 });
                    Content::Info
                }
            };
            assert_eq!(content, output.content, "{}", output.topic);
        }
    }
}
