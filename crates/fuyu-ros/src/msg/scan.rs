//! Scan of a serialized message with a known definition, for the stamp of its header and for numbers that are not
//! finite.

use super::builtin_interfaces::Time;
use super::{Base, Definition, Shape};

/// Result of a scan.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scan {
    /// Stamp of the message's header, if it has one.
    pub stamp: Option<Time>,
    /// Name of the first field that is NaN or infinite, such as `pose.position.x` or `effort[2]`.
    pub not_finite: Option<String>,
}

/// Bytes that are not a message of the expected type.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the bytes end early or are not plain CDR")]
pub struct Malformed;

/// Scans CDR bytes (with their encapsulation header) of a message that `definition` defines.
///
/// # Errors
/// [`Malformed`] if the bytes do not hold such a message.
pub fn scan(definition: &Definition, cdr: &[u8]) -> Result<Scan, Malformed> {
    let (big_endian, body) = match cdr {
        [0, 0, _, _, body @ ..] => (true, body),
        [0, 1, _, _, body @ ..] => (false, body),
        _ => return Err(Malformed),
    };
    let mut walk = Walk {
        body,
        at: 0,
        big_endian,
        path: Vec::new(),
        found: Scan::default(),
    };
    walk.message(definition)?;
    Ok(walk.found)
}

struct Walk<'a> {
    body: &'a [u8],
    at: usize,
    big_endian: bool,
    path: Vec<(&'static str, Option<usize>)>,
    found: Scan,
}

impl Walk<'_> {
    fn message(&mut self, definition: &Definition) -> Result<(), Malformed> {
        for field in definition.fields {
            let many = match field.ty.shape {
                Shape::One => None,
                Shape::Array(n) => Some(n),
                Shape::Sequence | Shape::Bounded(_) => Some(self.unsigned()? as usize),
            };
            self.path.push((field.name, None));
            match many {
                None => self.element(field.ty.base)?,
                // Arrays of numbers other than floats are skipped as a whole.
                Some(n) if skipped_size(field.ty.base).is_some() => {
                    if let (Some(size), true) = (skipped_size(field.ty.base), n > 0) {
                        self.align(size);
                        self.take(n.checked_mul(size).ok_or(Malformed)?)?;
                    }
                }
                Some(n) => {
                    for i in 0..n {
                        if let Some(last) = self.path.last_mut() {
                            last.1 = Some(i);
                        }
                        self.element(field.ty.base)?;
                    }
                }
            }
            self.path.pop();
        }
        Ok(())
    }

    fn element(&mut self, base: Base) -> Result<(), Malformed> {
        match base {
            Base::Float32 => {
                let bytes = self.number::<4>()?;
                self.check(f32::from_le_bytes(bytes).is_finite());
            }
            Base::Float64 => {
                let bytes = self.number::<8>()?;
                self.check(f64::from_le_bytes(bytes).is_finite());
            }
            Base::String => {
                let length = self.unsigned()? as usize;
                self.take(length)?;
            }
            Base::Message(d) if (d.package, d.name) == ("builtin_interfaces", "Time") => {
                let sec = i32::from_le_bytes(self.number()?);
                let nanosec = self.unsigned()?;
                if self.path.iter().map(|p| p.0).eq(["header", "stamp"]) {
                    self.found.stamp = Some(Time { sec, nanosec });
                }
            }
            Base::Message(d) => self.message(d)?,
            Base::Bool | Base::Byte | Base::Int8 | Base::Uint8 => {
                self.take(1)?;
            }
            Base::Int16 | Base::Uint16 => {
                self.number::<2>()?;
            }
            Base::Int32 | Base::Uint32 => {
                self.number::<4>()?;
            }
            Base::Int64 | Base::Uint64 => {
                self.number::<8>()?;
            }
        }
        Ok(())
    }

    fn check(&mut self, finite: bool) {
        if !finite && self.found.not_finite.is_none() {
            let parts = self.path.iter().map(|(name, index)| match index {
                Some(i) => format!("{name}[{i}]"),
                None => (*name).to_owned(),
            });
            self.found.not_finite = Some(parts.collect::<Vec<_>>().join("."));
        }
    }

    fn align(&mut self, size: usize) {
        self.at = self.at.next_multiple_of(size);
    }

    fn take(&mut self, n: usize) -> Result<&[u8], Malformed> {
        let end = self.at.checked_add(n).ok_or(Malformed)?;
        let bytes = self.body.get(self.at..end).ok_or(Malformed)?;
        self.at = end;
        Ok(bytes)
    }

    /// Little-endian bytes of a number of `N` bytes.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        self.align(N);
        let mut bytes: [u8; N] = self.take(N)?.try_into().map_err(|_| Malformed)?;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn unsigned(&mut self) -> Result<u32, Malformed> {
        Ok(u32::from_le_bytes(self.number()?))
    }
}

fn skipped_size(base: Base) -> Option<usize> {
    match base {
        Base::Bool | Base::Byte | Base::Int8 | Base::Uint8 => Some(1),
        Base::Int16 | Base::Uint16 => Some(2),
        Base::Int32 | Base::Uint32 => Some(4),
        Base::Int64 | Base::Uint64 => Some(8),
        Base::Float32 | Base::Float64 | Base::String | Base::Message(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{Interface, cdr, geometry_msgs, nav_msgs, sensor_msgs, std_msgs, tf2_msgs};

    fn scanned<M: Interface>(message: &M) -> Scan {
        scan(M::DEFINITION, &cdr::encode(message)).unwrap()
    }

    #[test]
    fn stamps_are_found_where_headers_are() {
        let stamp = Time { sec: 5, nanosec: 7 };
        let mut joints = sensor_msgs::JointState::default();
        joints.header.stamp = stamp.clone();
        joints.name = vec!["a".into(), "bc".into()];
        joints.effort = vec![1.0];
        assert_eq!(scanned(&joints).stamp, Some(stamp.clone()));
        // The header of a contained transform is not the header of the message.
        let mut t = geometry_msgs::TransformStamped::default();
        t.header.stamp = stamp;
        assert!(scanned(&t).stamp.is_some());
        assert_eq!(
            scanned(&tf2_msgs::TFMessage {
                transforms: vec![t]
            })
            .stamp,
            None
        );
        assert_eq!(scanned(&std_msgs::Bool::default()), Scan::default());
    }

    #[test]
    fn numbers_that_are_not_finite_are_named() {
        let mut joints = sensor_msgs::JointState {
            name: vec!["a".into()],
            velocity: vec![0.0, f64::NAN],
            effort: vec![f64::INFINITY],
            ..Default::default()
        };
        assert_eq!(scanned(&joints).not_finite.as_deref(), Some("velocity[1]"));
        joints.velocity.clear();
        assert_eq!(scanned(&joints).not_finite.as_deref(), Some("effort[0]"));
        let mut path = nav_msgs::Path {
            poses: vec![Default::default(); 2],
            ..Default::default()
        };
        path.poses[1].pose.orientation.w = f64::NAN;
        assert_eq!(
            scanned(&path).not_finite.as_deref(),
            Some("poses[1].pose.orientation.w")
        );
        let joy = sensor_msgs::Joy {
            axes: vec![f32::NEG_INFINITY],
            buttons: vec![1, 2, 3],
            ..Default::default()
        };
        assert_eq!(scanned(&joy).not_finite.as_deref(), Some("axes[0]"));
    }

    #[test]
    fn every_message_is_scanned_to_its_end() {
        fn check<M: Interface>() {
            let bytes = cdr::encode(&M::default());
            assert!(scan(M::DEFINITION, &bytes).is_ok());
            assert!(
                scan(M::DEFINITION, &bytes[..bytes.len() - 1]).is_err(),
                "{}",
                M::NAME
            );
        }
        check::<sensor_msgs::CameraInfo>();
        check::<sensor_msgs::Image>();
        check::<nav_msgs::Odometry>();
        check::<crate::msg::rcl_interfaces::ParameterValue>();
        check::<crate::msg::diagnostic_msgs::DiagnosticStatus>();
        check::<crate::msg::fuyu_msgs::ControllerState>();
    }
}
