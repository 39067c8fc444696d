//! Parameters of rendered images.

use fuyu_render::{Distortion, Earth, Intrinsics, Sensor, Transfer};
use nalgebra::Vector3;

use crate::{
    nodes::{camera::CAMERA_FRAME, choice, placement::finite},
    ros::{Declare, Param},
    vision::StreamConfig,
};

/// The main camera, which also sees the features.
pub use crate::nodes::topics::CAMERA as MAIN;

/// The images of the camera node.
#[derive(Debug, Clone)]
pub struct ImageParams {
    /// The cameras.
    pub cameras: Vec<CameraSpec>,
    /// Targets that are drawn in addition to the robot.
    pub bodies: Vec<String>,
    /// Samples per pixel.
    pub samples: usize,
    /// Number of rendering threads.
    pub threads: usize,
    /// Columns and rows of the shadow map.
    pub shadow_resolution: usize,
    /// Live parameters, which may change while the node runs.
    pub settings: ImageSettings,
}

/// One camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSpec {
    /// Its name, the prefix of its topics.
    pub name: String,
    /// The link whose frame is its optical frame.
    pub link: String,
    /// Size and intrinsic parameters.
    pub intrinsics: Intrinsics,
    /// Distortion of its lens.
    pub distortion: Distortion,
    /// Encoding of its images.
    pub colour: Colour,
    /// Format of compressed images.
    pub compressed: Compression,
    /// Quality of JPEG, 1 to 100.
    pub jpeg_quality: u8,
    /// Encoding of depth images.
    pub depth: Depth,
    /// Whether segmentation images, with ids of bodies, are published.
    pub segmentation: bool,
    /// Distance of the right camera of a stereo pair \[m\]; 0 for a single camera.
    pub baseline: f64,
}

/// Encoding of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// Grey.
    Mono8,
    /// Red, green, blue.
    Rgb8,
}

/// Format of compressed images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    /// Not published.
    None,
    /// Lossless.
    Png,
    /// Lossy.
    Jpeg,
}

/// Encoding of depth images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Not published.
    None,
    /// Millimetres.
    Millimetres,
    /// Metres.
    Metres,
}

const COLOURS: [(&str, Colour); 2] = [("mono8", Colour::Mono8), ("rgb8", Colour::Rgb8)];
const COMPRESSIONS: [(&str, Compression); 3] = [
    ("none", Compression::None),
    ("png", Compression::Png),
    ("jpeg", Compression::Jpeg),
];
const DEPTHS: [(&str, Depth); 3] = [
    ("none", Depth::None),
    ("16UC1", Depth::Millimetres),
    ("32FC1", Depth::Metres),
];
const TRANSFERS: [(&str, Transfer); 2] = [("linear", Transfer::Linear), ("srgb", Transfer::Srgb)];

impl Colour {
    /// Its name in `sensor_msgs/Image`.
    pub fn name(self) -> &'static str {
        choice::name_of(&COLOURS, &self)
    }
}

impl Depth {
    /// Its name in `sensor_msgs/Image`.
    pub fn name(self) -> &'static str {
        choice::name_of(&DEPTHS, &self)
    }
}

/// Settings that may change while the node runs.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageSettings {
    /// Rate, latency and losses.
    pub stream: StreamConfig,
    /// Exposure and noise.
    pub sensor: Sensor,
    /// Direction toward the Sun in the world.
    pub sun: Vector3<f64>,
    /// Solar irradiance; 1 is full sunlight.
    pub sun_intensity: f64,
    /// Ambient light, relative to full sunlight.
    pub ambient: f64,
    /// The Earth, if there is one.
    pub earth: Option<Earth>,
    /// Magnitude of the faintest stars.
    pub faintest_star: f64,
    /// Gain of the stars' brightness; 1 is physical.
    pub star_gain: f64,
}

/// Parameter handles of [`ImageSettings`].
pub struct LiveImageSettings {
    floats: [Param<f64>; 11],
    seed: Param<i64>,
    shot_noise: Param<bool>,
    transfer: Param<String>,
    sun: Param<Vec<f64>>,
    earth: Param<Vec<f64>>,
}

impl LiveImageSettings {
    fn declare(declare: &mut Declare) -> Self {
        let mut float = |name: &str, default: f64, [from, to]: [f64; 2], text: &str| {
            let parameter = declare.param(&format!("images.{name}"), default, text);
            parameter.range(from, to).live()
        };
        let floats = [
            float(
                "rate",
                10.0,
                [0.0, 1000.0],
                "Images per second [Hz]; 0 is an image for every state",
            ),
            float(
                "latency",
                0.0,
                [0.0, 10.0],
                "Delay from exposure to publication of images [s]",
            ),
            float(
                "dropout",
                0.0,
                [0.0, 1.0],
                "Probability that an image is lost",
            ),
            float(
                "exposure",
                1e-3,
                [1e-6, 10.0],
                "Exposure of images [s]; the stamp is its middle",
            ),
            float(
                "sensitivity",
                1e7,
                [1.0, 1e15],
                "Electrons per second in a pixel that sees a white surface in full sunlight",
            ),
            float(
                "full_well",
                12_000.0,
                [1.0, 1e9],
                "Electrons that a pixel holds; they are the value 255",
            ),
            float(
                "read_noise",
                10.0,
                [0.0, 1e6],
                "Standard deviation of the read noise [electrons]",
            ),
            float(
                "sun.intensity",
                1.0,
                [0.0, 100.0],
                "Irradiance of the Sun, of full sunlight; 0 is an eclipse",
            ),
            float(
                "ambient",
                0.005,
                [0.0, 100.0],
                "Light from all directions, of full sunlight",
            ),
            float(
                "stars.faintest",
                6.5,
                [-2.0, 9.0],
                "Apparent magnitude of the faintest stars",
            ),
            float(
                "stars.gain",
                1.0,
                [0.0, 1e9],
                "Brightness of stars; 1 is physical, at which they are seldom visible next to sunlit bodies",
            ),
        ];
        let seed = declare.param("images.seed", 1, "Seed of noise and losses of images");
        let seed = seed.live();
        let shot_noise = declare.param(
            "images.shot_noise",
            true,
            "Whether the number of electrons in a pixel is random",
        );
        let shot_noise = shot_noise.live();
        let transfer = choice::declare(
            declare,
            "images.transfer",
            &TRANSFERS,
            "How electrons become values",
        );
        let transfer = transfer.live();
        let sun = declare.param(
            "images.sun.direction",
            [-0.5, -0.7, 0.5],
            "Direction toward the Sun in the world; need not be a unit vector",
        );
        let sun = sun.check("3 finite numbers, not all zero", |v| {
            finite(v, 3)?;
            match v.iter().any(|x| *x != 0.0) {
                true => Ok(()),
                false => Err("a direction cannot be zero".to_owned()),
            }
        });
        let sun = sun.live();
        let earth = declare.param(
            "images.earth",
            Vec::<f64>::new(),
            "Position of the Earth's centre in the world [m]; empty is no Earth",
        );
        let earth = earth.check("3 finite numbers; empty is none", |v| {
            if v.is_empty() { Ok(()) } else { finite(v, 3) }
        });
        let earth = earth.live();
        Self {
            floats,
            seed,
            shot_noise,
            transfer,
            sun,
            earth,
        }
    }

    /// The current settings.
    pub fn get(&self) -> ImageSettings {
        let [
            rate,
            latency,
            dropout,
            exposure,
            sensitivity,
            full_well,
            read_noise,
            sun_intensity,
            ambient,
            faintest_star,
            star_gain,
        ] = self.floats.each_ref().map(Param::get);
        let seed = self.seed.get().unsigned_abs();
        let vector = |values: &[f64]| match *values {
            [x, y, z] => Some(Vector3::new(x, y, z)),
            _ => None,
        };
        ImageSettings {
            stream: StreamConfig {
                rate,
                latency,
                dropout,
                seed,
            },
            sensor: Sensor {
                exposure,
                sensitivity,
                full_well,
                shot_noise: self.shot_noise.get(),
                read_noise,
                // Other names have been refused by the declaration.
                transfer: choice::find(&TRANSFERS, &self.transfer.get())
                    .unwrap_or(Transfer::Linear),
                seed,
            },
            sun: vector(&self.sun.get()).unwrap_or_else(Vector3::z),
            sun_intensity,
            ambient,
            earth: vector(&self.earth.get()).map(Earth::at),
            faintest_star,
            star_gain,
        }
    }

    /// Whether a parameter has changed since the last call.
    pub fn changed(&self) -> bool {
        // No short circuit: every handle must be queried, or it would report its change later.
        let floats = self.floats.iter().filter(|p| p.changed()).count();
        let others = [
            self.seed.changed(),
            self.shot_noise.changed(),
            self.transfer.changed(),
            self.sun.changed(),
            self.earth.changed(),
        ];
        floats > 0 || others.contains(&true)
    }
}

impl ImageParams {
    /// Declares and reads the parameters; `None` without cameras. `image` has width, height and focal length of the
    /// main camera \[px\], `target` is the target whose features it sees.
    ///
    /// # Errors
    /// A line that names the parameter with contradictory values.
    pub fn declare(
        declare: &mut Declare,
        image: (u32, u32, f64),
        target: Option<&str>,
    ) -> Result<(Option<Self>, LiveImageSettings), String> {
        let names = (declare.param(
            "images.cameras",
            Vec::<String>::new(),
            "Cameras whose images are rendered. Topics of NAME begin with NAME/; `camera` sees the features, too. Empty is none",
        ))
        .read_only()
        .check("names of letters, digits and _", |names| names_are_valid(names))
        .value();
        let mut bodies = (declare.param(
            "images.bodies",
            Vec::<String>::new(),
            "Targets that are drawn, with the robot; empty is features.target",
        ))
        .read_only()
        .check("names of this robot's targets", |names| {
            match names.iter().find(|n| n.starts_with('/') || n.is_empty()) {
                Some(name) => Err(format!(
                    "'{name}' is not a target of this robot's simulation; only those can be drawn"
                )),
                None => Ok(()),
            }
        })
        .value();
        if bodies.is_empty() {
            bodies.extend(target.filter(|t| !t.starts_with('/')).map(str::to_owned));
        }
        let mut count = |name: &str, default: i64, to: i64, text: &str| {
            let parameter = declare.param(&format!("images.{name}"), default, text);
            let value = parameter.range(1, to).read_only().value();
            usize::try_from(value).unwrap_or(1)
        };
        let samples = count(
            "samples",
            1,
            64,
            "Samples per pixel, spread over its area and over the exposure; 1 is neither smoothed nor blurred",
        );
        let threads = count("threads", 1, 256, "Threads that render images");
        let shadow_resolution = count(
            "shadow_resolution",
            2048,
            8192,
            "Columns and rows of the shadow map",
        );
        let live = LiveImageSettings::declare(declare);
        let mut cameras = Vec::new();
        for name in names {
            cameras.push(CameraSpec::declare(declare, name, image)?);
        }
        if cameras.is_empty() {
            return Ok((None, live));
        }
        let params = Self {
            cameras,
            bodies,
            samples,
            threads,
            shadow_resolution,
            settings: live.get(),
        };
        Ok((Some(params), live))
    }

    /// Lens distortion of the main camera, which sees the features; `None` if its images are not rendered.
    pub fn main_lens(&self) -> Option<Distortion> {
        let main = self.cameras.iter().find(|c| c.name == MAIN)?;
        Some(main.distortion)
    }
}

fn names_are_valid(names: &[String]) -> Result<(), String> {
    let is_valid = |name: &String| {
        let starts = name.starts_with(|c: char| c.is_ascii_lowercase());
        starts && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    for (i, name) in names.iter().enumerate() {
        if !is_valid(name) {
            return Err(format!("'{name}' cannot be part of a topic's name"));
        }
        if names[..i].contains(name) {
            return Err(format!("'{name}' is given twice"));
        }
    }
    Ok(())
}

impl CameraSpec {
    fn declare(
        declare: &mut Declare,
        name: String,
        (width, height, focal_length): (u32, u32, f64),
    ) -> Result<Self, String> {
        let key = |part: &str| format!("images.{name}.{part}");
        let link = (declare.param(
            &key("link"),
            CAMERA_FRAME,
            "Link whose frame is the camera's optical frame: z forward, x right, y down (REP-103)",
        ))
        .read_only()
        .value();
        let is_main = name == MAIN;
        let mut size = |part: &str, default: u32, text: &str| {
            let parameter = declare.param(&key(part), i64::from(default), text);
            let value = parameter.range(16, 8192).read_only().value();
            u32::try_from(value).unwrap_or(default)
        };
        // Features and images of the main camera share one calibration.
        let (width, height) = match is_main {
            true => (width, height),
            false => (
                size("width", width, "Width of the image [px]"),
                size("height", height, "Height of the image [px]"),
            ),
        };
        let focal_length = match is_main {
            true => focal_length,
            false => (declare.param(&key("focal_length"), focal_length, "Focal length [px]"))
                .range(1.0, 1e6)
                .read_only()
                .value(),
        };
        let model = (declare.param(
            &key("distortion_model"),
            "plumb_bob",
            "Distortion of the lens, as in CameraInfo: plumb_bob or equidistant",
        ))
        .read_only()
        .value();
        let coefficients = (declare.param(
            &key("distortion"),
            Vec::<f64>::new(),
            "Its coefficients: k1, k2, p1, p2, k3 of plumb_bob, k1 to k4 of equidistant; empty is no distortion",
        ))
        .read_only()
        .value();
        let colour = choice::declare(declare, &key("encoding"), &COLOURS, "Encoding of images");
        let colour = colour.read_only().value();
        let compressed = choice::declare(
            declare,
            &key("compressed"),
            &COMPRESSIONS,
            "Format of compressed images",
        );
        let compressed = compressed.read_only().value();
        let quality = (declare.param(&key("jpeg_quality"), 90, "Quality of JPEG images"))
            .range(1, 100)
            .read_only()
            .value();
        let depth = choice::declare(declare, &key("depth"), &DEPTHS, "Encoding of depth images");
        let depth = depth.read_only().value();
        let segmentation = (declare.param(
            &key("segmentation"),
            false,
            "Whether images with the ids of bodies are published",
        ))
        .read_only()
        .value();
        let baseline = (declare.param(
            &key("baseline"),
            0.0,
            "Distance of a second camera to the right [m]; 0 is none. The two are NAME/left and NAME/right",
        ))
        .range(0.0, 100.0)
        .read_only()
        .value();
        let lens = match coefficients.is_empty() && model == "equidistant" {
            true => Distortion::new(&model, &[0.0; 4]),
            false => Distortion::new(&model, &coefficients),
        };
        let distortion = lens.map_err(|e| format!("parameter images.{name}.distortion: {e}"))?;
        Ok(Self {
            link,
            intrinsics: Intrinsics::centred(width, height, focal_length),
            distortion,
            // Other names have been refused by the declarations.
            colour: choice::find(&COLOURS, &colour).unwrap_or(Colour::Mono8),
            compressed: choice::find(&COMPRESSIONS, &compressed).unwrap_or(Compression::None),
            jpeg_quality: u8::try_from(quality).unwrap_or(90),
            depth: choice::find(&DEPTHS, &depth).unwrap_or(Depth::None),
            segmentation,
            baseline,
            name,
        })
    }
}
