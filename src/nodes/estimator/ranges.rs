//! Distances of feature points, measured by point clouds of a stereo pair, a depth camera or a lidar.

use std::collections::VecDeque;

use nalgebra::Vector3;

use crate::{
    estimation::bundle::MeasuredRange,
    msg::sensor_msgs::{PointCloud2, PointField},
    ros::Time,
    vision::{Feature, FeatureFrame, Pinhole},
};

/// A feature gets the distance of the nearest cloud point in the image, if that is within this radius \[px\].
const NEARBY: f64 = 2.0;

/// Least time between two clouds that are used \[s\]; more are not needed, since the scale does not change.
const PERIOD: f64 = 1.0;

/// Maximum number of clouds that wait for a frame.
const WAITING: usize = 4;

/// Largest time difference between a cloud and its nearest frame \[s\].
const LONGEST: f64 = 0.1;

/// A point cloud: points in camera axes \[m\] at one time.
struct Cloud {
    time: f64,
    points: Vec<Vector3<f64>>,
}

/// Measured distances of feature points.
#[derive(Default)]
pub struct Ranges {
    waiting: VecDeque<Cloud>,
    measured: Vec<MeasuredRange>,
    /// Stamp of the newest cloud taken \[s\].
    taken_at: Option<f64>,
}

impl Ranges {
    /// The distances measured within the window, in order of frames.
    pub fn measured(&self) -> &[MeasuredRange] {
        &self.measured
    }

    /// Discards distances measured before a time \[s\].
    pub fn forget_before(&mut self, time: f64) {
        self.measured.retain(|range| range.time >= time);
    }

    /// Takes a cloud whose coordinates are in the frame `camera`; ignores it if the last one was less than a second
    /// ago.
    ///
    /// # Errors
    /// Names the invalid field of the message.
    pub fn take(&mut self, message: &PointCloud2, camera: &str) -> Result<(), String> {
        let time = Time::from(&message.header.stamp).as_secs_f64();
        if (self.taken_at).is_some_and(|at| time >= at && time < at + PERIOD) {
            return Ok(());
        }
        let frame = &message.header.frame_id;
        if frame != camera {
            return Err(format!(
                "header.frame_id is '{frame}'; points must be in the camera's frame '{camera}'"
            ));
        }
        let points = points_of(message)?;
        self.taken_at = Some(time);
        self.waiting.push_back(Cloud { time, points });
        if self.waiting.len() > WAITING {
            self.waiting.pop_front();
        }
        Ok(())
    }

    /// Time \[s\] from which frames are needed for the oldest waiting cloud.
    pub fn frames_needed_from(&self) -> Option<f64> {
        self.waiting.front().map(|cloud| cloud.time - LONGEST)
    }

    /// Measures the features of the frames nearest in time to the waiting clouds. Returns the number of features
    /// measured with the last cloud used; `None` if no cloud was used.
    pub fn measure(&mut self, frames: &[FeatureFrame], camera: &Pinhole) -> Option<usize> {
        let newest = frames.last()?.time;
        let mut found = None;
        while (self.waiting.front()).is_some_and(|cloud| cloud.time <= newest) {
            let cloud = self.waiting.pop_front()?;
            let after = frames.partition_point(|f| f.time < cloud.time);
            let nearest = frames[after.saturating_sub(1)..].iter().take(2);
            let apart = |frame: &FeatureFrame| (frame.time - cloud.time).abs();
            let Some(frame) = nearest.min_by(|a, b| apart(a).total_cmp(&apart(b))) else {
                continue;
            };
            if apart(frame) > LONGEST {
                continue;
            }
            let before = self.measured.len();
            self.measured
                .extend(measured_in(frame, &cloud.points, camera));
            found = Some(self.measured.len() - before);
        }
        found
    }
}

/// The distances of the features of a frame, ordered by id. A cloud has up to hundreds of thousands of points, so each
/// point is compared only with features in nearby image columns.
fn measured_in(
    frame: &FeatureFrame,
    points: &[Vector3<f64>],
    camera: &Pinhole,
) -> Vec<MeasuredRange> {
    let mut features: Vec<&Feature> = frame.features.iter().collect();
    features.sort_by(|a, b| a.u.total_cmp(&b.u));
    // Of the nearest point: distance in the image \[px\], and distance from the camera \[m\].
    let mut nearest: Vec<Option<(f64, f64)>> = vec![None; features.len()];
    for point in points {
        let Some([u, v]) = camera.project(point) else {
            continue;
        };
        let first = features.partition_point(|f| f.u < u - NEARBY);
        for (feature, nearest) in features.iter().zip(&mut nearest).skip(first) {
            if feature.u > u + NEARBY {
                break;
            }
            let apart = (u - feature.u).hypot(v - feature.v);
            if apart <= NEARBY && nearest.is_none_or(|(least, _)| apart < least) {
                *nearest = Some((apart, point.norm()));
            }
        }
    }
    let found = features.iter().zip(nearest);
    let mut measured: Vec<_> = found
        .filter_map(|(feature, nearest)| {
            let (_, metres) = nearest?;
            Some(MeasuredRange {
                id: feature.id,
                time: frame.time,
                metres,
            })
        })
        .collect();
    measured.sort_by_key(|range| range.id);
    measured
}

/// The finite points of a cloud.
fn points_of(message: &PointCloud2) -> Result<Vec<Vector3<f64>>, String> {
    let step = message.point_step as usize;
    let [x, y, z] = ["x", "y", "z"].map(|name| {
        let field = message.fields.iter().find(|f| f.name == name);
        let field = field.ok_or_else(|| format!("fields has no '{name}'"))?;
        let size = match field.datatype {
            PointField::FLOAT32 => 4,
            PointField::FLOAT64 => 8,
            other => {
                return Err(format!(
                    "field '{name}' has datatype {other}; it must be 7 (FLOAT32) or 8 (FLOAT64)"
                ));
            }
        };
        match (field.offset as usize).checked_add(size) {
            Some(end) if end <= step => Ok(field),
            _ => Err(format!(
                "field '{name}' at offset {} is not within point_step, which is {step}",
                field.offset
            )),
        }
    });
    let fields = [x?, y?, z?];
    let (row_step, width) = (message.row_step as usize, message.width as usize);
    let rows = message.height as usize;
    if width.checked_mul(step).is_none_or(|least| row_step < least)
        || (row_step.checked_mul(rows)).is_none_or(|least| message.data.len() < least)
    {
        return Err(format!(
            "data has {} bytes and row_step is {row_step}; {width} times {rows} points of {step} bytes need more",
            message.data.len()
        ));
    }
    let value = |point: &[u8], field: &PointField| {
        let from = &point[field.offset as usize..];
        match (field.datatype, message.is_bigendian) {
            (PointField::FLOAT64, false) => from.first_chunk().map(|b| f64::from_le_bytes(*b)),
            (PointField::FLOAT64, true) => from.first_chunk().map(|b| f64::from_be_bytes(*b)),
            (_, false) => from
                .first_chunk()
                .map(|b| f64::from(f32::from_le_bytes(*b))),
            (_, true) => from
                .first_chunk()
                .map(|b| f64::from(f32::from_be_bytes(*b))),
        }
    };
    let rows = message.data.chunks_exact(row_step.max(1)).take(rows);
    let points = rows.flat_map(|row| row.chunks_exact(step).take(width));
    let points = points.filter_map(|point| {
        let [x, y, z] = fields.map(|field| value(point, field));
        Some(Vector3::new(x?, y?, z?)).filter(|p| p.iter().all(|v| v.is_finite()))
    });
    Ok(points.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOAT32: u8 = PointField::FLOAT32;
    const FLOAT64: u8 = PointField::FLOAT64;

    const CAMERA: Pinhole = Pinhole {
        fx: 500.0,
        fy: 500.0,
        cx: 320.0,
        cy: 240.0,
    };

    /// A cloud with a colour between z and the end of each point, as drivers send.
    fn cloud(time: f64, points: &[[f64; 3]], is_bigendian: bool, datatype: u8) -> PointCloud2 {
        let size = if datatype == FLOAT64 { 8 } else { 4 };
        let mut data = Vec::new();
        for point in points {
            for value in point {
                match (datatype, is_bigendian) {
                    (FLOAT64, false) => data.extend(value.to_le_bytes()),
                    (FLOAT64, true) => data.extend(value.to_be_bytes()),
                    (_, false) => data.extend((*value as f32).to_le_bytes()),
                    (_, true) => data.extend((*value as f32).to_be_bytes()),
                }
            }
            data.extend([1, 2, 3, 4]);
        }
        let names = ["x", "y", "z"].iter().zip(0..);
        let fields = names.map(|(name, k)| PointField {
            name: (*name).to_owned(),
            offset: k * size,
            datatype,
            count: 1,
        });
        let mut message = PointCloud2 {
            height: 1,
            width: points.len() as u32,
            fields: fields.collect(),
            is_bigendian,
            point_step: 3 * size + 4,
            row_step: (3 * size + 4) * points.len() as u32,
            data,
            ..PointCloud2::default()
        };
        message.header.frame_id = "camera".to_owned();
        message.header.stamp = Time::from_secs_f64(time).into();
        message
    }

    fn frame(time: f64, features: &[(u64, f64, f64)]) -> FeatureFrame {
        let features = features.iter().map(|&(id, u, v)| Feature { id, u, v });
        FeatureFrame::new(time, features.collect())
    }

    #[test]
    fn points_are_read_in_both_sizes_and_byte_orders() {
        let points = [[0.5, -1.0, 4.0], [f64::NAN, 0.0, 1.0], [0.25, 0.0, 2.0]];
        for datatype in [FLOAT32, FLOAT64] {
            for is_bigendian in [false, true] {
                let read = points_of(&cloud(0.0, &points, is_bigendian, datatype)).unwrap();
                assert_eq!(
                    read,
                    [Vector3::new(0.5, -1.0, 4.0), Vector3::new(0.25, 0.0, 2.0)]
                );
            }
        }
    }

    #[test]
    fn a_feature_has_the_distance_of_the_nearest_point_in_the_image() {
        let mut ranges = Ranges::default();
        // At pixels (320, 240) and (445, 240), and behind the camera.
        let points = [[0.0, 0.0, 3.0], [1.0, 0.0, 4.0], [0.0, 0.0, -3.0]];
        ranges
            .take(&cloud(1.02, &points, false, FLOAT32), "camera")
            .unwrap();
        // A second cloud within a second is not used.
        ranges
            .take(&cloud(1.5, &points, false, FLOAT32), "camera")
            .unwrap();
        let frames = [
            frame(0.9, &[(7, 320.0, 240.0)]),
            frame(
                1.0,
                &[(3, 321.0, 240.5), (5, 446.0, 240.0), (6, 400.0, 240.0)],
            ),
            frame(1.1, &[(7, 320.0, 240.0)]),
        ];
        // The nearest frame may be the next one.
        assert_eq!(ranges.measure(&frames[..2], &CAMERA), None);
        assert_eq!(ranges.measure(&frames, &CAMERA), Some(2));
        let measured: Vec<_> = ranges
            .measured()
            .iter()
            .map(|r| (r.id, r.time, r.metres))
            .collect();
        assert_eq!(measured, [(3, 1.0, 3.0), (5, 1.0, 17f64.sqrt())]);
        assert_eq!(ranges.measure(&frames, &CAMERA), None);
        ranges.forget_before(1.05);
        assert!(ranges.measured().is_empty());
    }

    #[test]
    fn wrong_clouds_are_refused_with_the_field() {
        let right = cloud(0.0, &[[0.0, 0.0, 1.0]], false, FLOAT32);
        let refused = |change: fn(&mut PointCloud2)| {
            let mut wrong = right.clone();
            change(&mut wrong);
            Ranges::default().take(&wrong, "camera").unwrap_err()
        };
        assert!(refused(|c| c.header.frame_id = "lidar".to_owned()).contains("'lidar'"));
        assert!(refused(|c| c.fields[2].name = "w".to_owned()).contains("no 'z'"));
        assert!(refused(|c| c.fields[1].datatype = 5).contains("datatype 5"));
        assert!(refused(|c| c.fields[1].offset = u32::MAX).contains("offset"));
        assert!(refused(|c| c.point_step = 8).contains("point_step"));
        assert!(refused(|c| c.width = u32::MAX).contains("bytes"));
        assert!(refused(|c| c.height = 2).contains("bytes"));
        // An empty cloud is valid.
        let empty = cloud(0.0, &[], false, FLOAT32);
        Ranges::default().take(&empty, "camera").unwrap();
    }
}
