//! DDS domain and discovery range, from the environment variables of ROS.

/// How far discovery reaches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DiscoveryRange {
    /// Every network interface.
    Subnet,
    /// This computer only: nothing is sent on any interface but `lo`.
    Localhost,
    /// No discovery, not even on this computer.
    Off,
}

/// DDS domain and discovery range of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Domain {
    /// `ROS_DOMAIN_ID`.
    pub id: u16,
    /// How far discovery reaches.
    pub range: DiscoveryRange,
}

/// An environment variable with a value that ROS does not accept.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{variable}={value:?}: {expected}")]
pub struct DomainError {
    variable: &'static str,
    value: String,
    expected: String,
}

impl DomainError {
    pub(super) fn new(variable: &'static str, value: &str, expected: impl Into<String>) -> Self {
        Self {
            variable,
            value: value.to_owned(),
            expected: expected.into(),
        }
    }
}

impl Domain {
    /// Largest domain id with port numbers below 65536.
    pub const MAX_ID: u16 = 232;

    /// Reads `ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE` and `ROS_LOCALHOST_ONLY`; `range` is the default. As in
    /// ROS, `ROS_LOCALHOST_ONLY=1` overrides the range.
    ///
    /// # Errors
    /// [`DomainError`] names the variable, its value and what would be right.
    pub fn from_env(range: DiscoveryRange) -> Result<Self, DomainError> {
        Self::from_variables(range, |name| std::env::var(name).ok())
    }

    fn from_variables(
        range: DiscoveryRange,
        get: impl Fn(&str) -> Option<String>,
    ) -> Result<Self, DomainError> {
        let read = |variable: &'static str, expected: &'static str| {
            let value = get(variable).unwrap_or_default().trim().to_owned();
            let error = DomainError::new(variable, &value, expected);
            (value, error)
        };

        let (value, error) = read("ROS_DOMAIN_ID", "expected a number from 0 to 232");
        let id = match value.as_str() {
            "" => 0,
            text => match text.parse::<u16>() {
                Ok(id) if id <= Self::MAX_ID => id,
                _ => return Err(error),
            },
        };

        let (value, error) = read(
            "ROS_AUTOMATIC_DISCOVERY_RANGE",
            "expected SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT",
        );
        let range = match value.as_str() {
            "" | "SYSTEM_DEFAULT" => range,
            "SUBNET" => DiscoveryRange::Subnet,
            "LOCALHOST" => DiscoveryRange::Localhost,
            "OFF" => DiscoveryRange::Off,
            _ => return Err(error),
        };

        let (value, error) = read("ROS_LOCALHOST_ONLY", "expected 0 or 1");
        let range = match value.as_str() {
            "1" => DiscoveryRange::Localhost,
            "" | "0" => range,
            _ => return Err(error),
        };

        Ok(Self { id, range })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn domain(vars: &[(&str, &str)]) -> Result<Domain, DomainError> {
        Domain::from_variables(DiscoveryRange::Subnet, |name| {
            let found = vars.iter().find(|(n, _)| *n == name);
            found.map(|(_, v)| (*v).to_owned())
        })
    }

    #[test]
    fn variables_mean_what_they_mean_in_ros() {
        let plain = domain(&[]).unwrap();
        assert_eq!((plain.id, plain.range), (0, DiscoveryRange::Subnet));
        assert_eq!(domain(&[("ROS_DOMAIN_ID", "232")]).unwrap().id, 232);
        let only = [
            ("ROS_LOCALHOST_ONLY", "1"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"),
        ];
        assert_eq!(domain(&only).unwrap().range, DiscoveryRange::Localhost);
        let range = [("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")];
        assert_eq!(domain(&range).unwrap().range, DiscoveryRange::Localhost);
        let off = [("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")];
        assert_eq!(domain(&off).unwrap().range, DiscoveryRange::Off);
    }

    #[test]
    fn wrong_values_are_named() {
        for (name, value) in [
            ("ROS_DOMAIN_ID", "233"),
            ("ROS_DOMAIN_ID", "-1"),
            ("ROS_DOMAIN_ID", "zero"),
            ("ROS_LOCALHOST_ONLY", "yes"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "localhost"),
        ] {
            let text = domain(&[(name, value)]).unwrap_err().to_string();
            assert!(text.contains(name) && text.contains(value), "{text}");
        }
    }
}
