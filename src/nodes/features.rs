//! Conversions between the camera's feature frames and messages.

use std::collections::BTreeSet;

use crate::{
    msg::{fuyu_msgs::FeatureTracks, sensor_msgs::CameraInfo, std_msgs::Header},
    ros::Time,
    vision::{Distortion, Feature, FeatureFrame, Pinhole},
};

/// A feature frame as a message. Features with ids beyond 32 bits are left out; fuyu's cameras give none.
pub fn feature_frame_to_msg(frame: &FeatureFrame, frame_id: &str) -> FeatureTracks {
    let features = frame.features.iter();
    let known = features.filter_map(|f| Some((u32::try_from(f.id).ok()?, f)));
    let mut message = FeatureTracks {
        header: Header {
            stamp: Time::from_secs_f64(frame.time).into(),
            frame_id: frame_id.to_owned(),
        },
        ..FeatureTracks::default()
    };
    for (id, feature) in known {
        message.ids.push(id);
        message.u.push(feature.u);
        message.v.push(feature.v);
    }
    message
}

/// A message as a feature frame.
///
/// # Errors
/// Names the invalid list or feature.
pub fn feature_frame_from_msg(message: &FeatureTracks) -> Result<FeatureFrame, String> {
    let (ids, u, v) = (message.ids.len(), message.u.len(), message.v.len());
    if ids != u || ids != v {
        return Err(format!(
            "ids, u and v have {ids}, {u} and {v} values; they must have one for each feature"
        ));
    }
    let pixels = message.u.iter().zip(&message.v);
    let features = message
        .ids
        .iter()
        .zip(pixels)
        .map(|(&id, (&u, &v))| Feature {
            id: id.into(),
            u,
            v,
        });
    let features: Vec<_> = features.collect();
    if let Some(bad) = features
        .iter()
        .find(|f| !(f.u.is_finite() && f.v.is_finite()))
    {
        return Err(format!(
            "feature {} is at pixel ({}, {}); both must be finite",
            bad.id, bad.u, bad.v
        ));
    }
    let mut seen = BTreeSet::new();
    if let Some(twice) = features.iter().find(|f| !seen.insert(f.id)) {
        return Err(format!("feature {} is there twice", twice.id));
    }
    let time = Time::from(&message.header.stamp).as_secs_f64();
    Ok(FeatureFrame::new(time, features))
}

/// The camera model and lens distortion of a calibration.
///
/// # Errors
/// If a focal length is not positive, or the distortion model is unknown.
pub fn camera_from_msg(info: &CameraInfo) -> Result<(Pinhole, Option<Distortion>), String> {
    let camera = Pinhole {
        fx: info.k[0],
        fy: info.k[4],
        cx: info.k[2],
        cy: info.k[5],
    };
    camera.check().map_err(|e| e.to_string())?;
    let lens = Distortion::new(&info.distortion_model, &info.d).map_err(|e| e.to_string())?;
    Ok((camera, lens))
}

/// The frame without lens distortion. Points outside the valid range of the lens are left out.
pub fn rectified(frame: FeatureFrame, camera: &Pinhole, lens: Option<&Distortion>) -> FeatureFrame {
    let Some(lens) = lens else { return frame };
    let features = frame.features.iter().filter_map(|f| {
        let [u, v] = lens.rectify(camera, f.u, f.v).ok()?;
        Some(Feature { id: f.id, u, v })
    });
    FeatureFrame::new(frame.time, features.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> FeatureFrame {
        let feature = |id| Feature {
            id,
            u: 10.5 + id as f64,
            v: 7.25,
        };
        FeatureFrame::new(12.5, vec![feature(3), feature(8)])
    }

    #[test]
    fn a_frame_is_unchanged_by_a_message() {
        let message = feature_frame_to_msg(&frame(), "camera_optical_frame");
        assert_eq!(message.header.frame_id, "camera_optical_frame");
        assert_eq!(feature_frame_from_msg(&message), Ok(frame()));
    }

    #[test]
    fn errors_name_what_is_wrong_with_a_frame() {
        let good = feature_frame_to_msg(&frame(), "camera");
        let refused = |change: fn(&mut FeatureTracks)| {
            let mut message = good.clone();
            change(&mut message);
            feature_frame_from_msg(&message).unwrap_err()
        };
        assert!(refused(|m| m.u.truncate(1)).contains("2, 1 and 2"));
        assert!(refused(|m| m.v[1] = f64::NAN).contains("feature 8 is at pixel (18.5, NaN)"));
        assert!(refused(|m| m.ids[1] = 3).contains("feature 3 is there twice"));
    }

    #[test]
    fn an_impossible_camera_is_refused() {
        let mut info = CameraInfo {
            k: [800.0, 0.0, 319.5, 0.0, 810.0, 239.5, 0.0, 0.0, 1.0],
            ..CameraInfo::default()
        };
        let (camera, lens) = camera_from_msg(&info).unwrap();
        assert_eq!(lens, None);
        assert_eq!((camera.fx, camera.cy), (800.0, 239.5));
        info.d = vec![0.1, 0.0, 0.0, 0.0, 0.0];
        info.distortion_model = "plumb_bob".to_owned();
        let expected = Distortion::PlumbBob([0.1, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(camera_from_msg(&info).unwrap().1, Some(expected));
        info.distortion_model = "thin_prism".to_owned();
        assert!(camera_from_msg(&info).unwrap_err().contains("thin_prism"));
        info.d.clear();
        info.k[0] = 0.0;
        assert!(camera_from_msg(&info).unwrap_err().contains("fx is 0"));
    }
}
