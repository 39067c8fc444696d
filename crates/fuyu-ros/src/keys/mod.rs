//! Keys and configurations for authenticated Zenoh: a certificate authority, a router that accepts only certificates of
//! that authority, and one configuration for each [`Role`], which defines the permissions of its holder.
//!
//! Every configuration is one self-contained file, which can be copied to another computer. The router enforces the
//! permissions of the roles ([`router`]). Sessions of a role connect to the router only, so that no message bypasses it.

mod authority;
mod role;
mod router;
mod session;

use std::{
    fs::{DirBuilder, OpenOptions},
    io::{self, Write},
    os::unix::fs::{DirBuilderExt, OpenOptionsExt},
    path::{Path, PathBuf},
    time::Duration,
};

use authority::{Authority, Identity};
pub use role::Role;

/// Options of a set of keys: address of the router, validity.
#[derive(Debug, Clone)]
pub struct KeyOptions {
    /// Host name or IP address at which the other computers reach the router.
    pub host: String,
    /// TCP port of the router.
    pub port: u16,
    /// How long the certificates are valid, from now.
    pub validity: Duration,
}

/// Why keys cannot be created.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KeyError {
    /// A file or folder cannot be written; existing ones are not overwritten.
    #[error("{}: {source}", .path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// An option does not make sense.
    #[error("{0}")]
    Option(String),
    /// The certificate library failed.
    #[error("certificates: {0}")]
    Certificate(#[from] rcgen::Error),
}

/// Creates `folder` with `authority.pem`, `authority.key`, `router.json5` and `ROLE.json5` for each role. Only the
/// owner may read the files. Returns their paths.
///
/// # Errors
/// [`KeyError`]; nothing that exists is overwritten.
pub fn create(folder: &Path, options: &KeyOptions) -> Result<Vec<PathBuf>, KeyError> {
    let authority = Authority::new(options.validity)?;
    let router = authority.identity("router", Some(&options.host), options.validity)?;
    let mut files = vec![
        ("authority.pem".to_owned(), authority.certificate()),
        ("authority.key".to_owned(), authority.key()),
        (
            "router.json5".to_owned(),
            router::configuration(options.port, &router, &authority),
        ),
    ];
    let host = match options.host.contains(':') {
        true => format!("[{}]", options.host),
        false => options.host.clone(),
    };
    let endpoint = format!("tls/{host}:{}", options.port);
    for role in Role::ALL {
        let identity = authority.identity(role.name(), None, options.validity)?;
        let text = session::configuration(role, &endpoint, &identity, &authority);
        files.push((format!("{}.json5", role.name()), text));
    }
    let failed = |path: &Path, source| KeyError::File {
        path: path.to_owned(),
        source,
    };
    let created = DirBuilder::new().recursive(true).mode(0o700).create(folder);
    created.map_err(|e| failed(folder, e))?;
    let mut paths = Vec::new();
    for (name, text) in files {
        let path = folder.join(name);
        write_secret(&path, &text).map_err(|e| failed(&path, e))?;
        paths.push(path);
    }
    Ok(paths)
}

fn write_secret(path: &Path, text: &str) -> io::Result<()> {
    let mut options = OpenOptions::new();
    let mut file = options
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(path)?;
    file.write_all(text.as_bytes())
}

/// The TLS part of a configuration: `listen` or `connect`.
fn tls(verb: &str, identity: &Identity, authority: &Authority) -> String {
    use base64::{Engine as _, prelude::BASE64_STANDARD};
    let encode = |pem: &str| BASE64_STANDARD.encode(pem);
    format!(
        r#"link: {{
      protocols: ["tls"],
      tls: {{
        enable_mtls: true,
        verify_name_on_connect: true,
        close_link_on_expiration: true,
        root_ca_certificate_base64: "{}",
        {verb}_certificate_base64: "{}",
        {verb}_private_key_base64: "{}",
      }},
    }},"#,
        encode(&authority.certificate()),
        encode(&identity.certificate),
        encode(&identity.key)
    )
}
