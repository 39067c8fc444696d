//! A certificate authority of one graph.

use rcgen::{
    BasicConstraints, Certificate, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose,
};
use std::time::{Duration, SystemTime};

use super::KeyError;

/// Certificates are valid from this long ago, since the clocks of computers may differ.
const CLOCK_DIFFERENCE: Duration = Duration::from_secs(600);

/// Signs certificates.
pub(super) struct Authority {
    certificate: Certificate,
    issuer: Issuer<'static, KeyPair>,
}

/// A certificate and its private key, both in PEM.
pub(super) struct Identity {
    pub(super) certificate: String,
    pub(super) key: String,
}

impl Authority {
    pub(super) fn new(validity: Duration) -> Result<Self, KeyError> {
        let key = KeyPair::generate()?;
        let mut params = parameters("fuyu authority", validity)?;
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        Ok(Self {
            certificate: params.self_signed(&key)?,
            issuer: Issuer::new(params, key),
        })
    }

    /// The authority's own certificate, in PEM.
    pub(super) fn certificate(&self) -> String {
        self.certificate.pem()
    }

    /// The authority's private key, in PEM.
    pub(super) fn key(&self) -> String {
        self.issuer.key().serialize_pem()
    }

    /// Issues a certificate with `name` as common name, by which access control recognises the holder; with a `host` it
    /// is a server's.
    pub(super) fn identity(
        &self,
        name: &str,
        host: Option<&str>,
        validity: Duration,
    ) -> Result<Identity, KeyError> {
        let key = KeyPair::generate()?;
        let mut params = parameters(name, validity)?;
        let hosts: Vec<_> = host.into_iter().map(str::to_owned).collect();
        params.subject_alt_names = CertificateParams::new(hosts)
            .map_err(|e| KeyError::Option(format!("host {host:?}: {e}")))?
            .subject_alt_names;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![match host {
            Some(_) => ExtendedKeyUsagePurpose::ServerAuth,
            None => ExtendedKeyUsagePurpose::ClientAuth,
        }];
        Ok(Identity {
            certificate: params.signed_by(&key, &self.issuer)?.pem(),
            key: key.serialize_pem(),
        })
    }
}

fn parameters(name: &str, validity: Duration) -> Result<CertificateParams, KeyError> {
    let mut params = CertificateParams::new(Vec::new())?;
    params.distinguished_name.remove(DnType::CommonName);
    params.distinguished_name.push(DnType::CommonName, name);
    // Seconds from 1970 to 2100.
    const LATEST: Duration = Duration::from_secs(4_102_444_800);
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let now = now.unwrap_or_default();
    let end = now.checked_add(validity).filter(|end| *end < LATEST);
    let Some(end) = end else {
        let days = validity.as_secs() / 86_400;
        return Err(KeyError::Option(format!(
            "{days} days: certificates end before the year 2100"
        )));
    };
    let epoch = rcgen::date_time_ymd(1970, 1, 1);
    params.not_before = epoch + now.saturating_sub(CLOCK_DIFFERENCE);
    params.not_after = epoch + end;
    Ok(params)
}
