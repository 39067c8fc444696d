//! The files of the cockpit's web page, which `just cockpit` builds.

use std::{collections::BTreeMap, path::Path, process::Command};

use crate::{input_file, nodes::resource};

/// Largest file of the page \[bytes\].
const LARGEST: u64 = 16 << 20;
/// Maximum number of files.
const MOST_FILES: usize = 256;

/// Content security policy of the page: it may use only its own files and its own server; inline styles are allowed for
/// the plotting library.
const POLICY: &str = "default-src 'self'; connect-src 'self' blob:; img-src 'self' blob: data:; \
                      style-src 'self' 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// The files in memory, so that requests cannot access other files.
pub struct Page(BTreeMap<String, (&'static str, Vec<u8>)>);

impl Page {
    /// Reads the page from the folder in which `just cockpit` builds it.
    ///
    /// # Errors
    /// A line that says whether the page or Node.js is missing.
    pub fn read() -> Result<Self, String> {
        let index = resource::resolve("package://fuyu/cockpit/dist/index.html").map_err(|_| {
            let npm = Command::new("npm").arg("--version").output();
            match npm.is_ok_and(|found| found.status.success()) {
                true => "--cockpit: the page is not built: run `just cockpit`, then again".to_owned(),
                false => "--cockpit: the page is not built, and Node.js, which builds it, is not installed: install Node.js 20.19 or later (https://nodejs.org), run `just cockpit`, then again".to_owned(),
            }
        })?;
        let index = index.path();
        let folder = index.parent().unwrap_or(Path::new("."));
        Self::of(folder).map_err(|e| format!("--cockpit: {e}"))
    }

    /// The files in `folder` and below.
    ///
    /// # Errors
    /// A line that names the file that cannot be read.
    pub fn of(folder: &Path) -> Result<Self, String> {
        let mut files = BTreeMap::new();
        let mut folders = vec![folder.to_owned()];
        while let Some(next) = folders.pop() {
            let entries = next
                .read_dir()
                .map_err(|e| format!("{}: {e}", next.display()))?;
            for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
                if path.is_dir() {
                    folders.push(path);
                    continue;
                }
                if files.len() >= MOST_FILES {
                    return Err(format!(
                        "{}: more than {MOST_FILES} files; is it the folder that `just cockpit` builds?",
                        folder.display()
                    ));
                }
                let Ok(relative) = path.strip_prefix(folder) else {
                    continue;
                };
                let parts = relative.iter().map(|part| part.to_string_lossy());
                let name = format!("/{}", parts.collect::<Vec<_>>().join("/"));
                let content = input_file::read(&path, LARGEST).map_err(|e| e.to_string())?;
                files.insert(name, (content_type(&path), content));
            }
        }
        Ok(Self(files))
    }

    /// The HTTP response to a request without a body.
    pub fn answer(&self, method: &str, target: &str) -> Vec<u8> {
        let path = target.split(['?', '#']).next().unwrap_or("/");
        let path = if path == "/" { "/index.html" } else { path };
        let (status, kind, body) = match (method, self.0.get(path)) {
            ("GET" | "HEAD", Some((kind, content))) => ("200 OK", *kind, content.as_slice()),
            ("GET" | "HEAD", None) => ("404 Not Found", "text/plain", &b"not found\n"[..]),
            _ => (
                "405 Method Not Allowed",
                "text/plain",
                &b"only GET and HEAD\n"[..],
            ),
        };
        let mut answer = format!(
            "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\
             Cache-Control: no-cache\r\nContent-Security-Policy: {POLICY}\r\nX-Content-Type-Options: nosniff\r\n\
             Referrer-Policy: no-referrer\r\nCross-Origin-Opener-Policy: same-origin\r\n\r\n",
            body.len()
        )
        .into_bytes();
        if method != "HEAD" {
            answer.extend_from_slice(body);
        }
        answer
    }
}

fn content_type(path: &Path) -> &'static str {
    match path.extension().and_then(|e| e.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("json" | "webmanifest") => "application/json",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_files_of_the_page_are_served() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("assets")).unwrap();
        std::fs::write(folder.path().join("index.html"), "<p>").unwrap();
        std::fs::write(folder.path().join("assets/a.js"), "1").unwrap();
        let page = Page::of(folder.path()).unwrap();
        let text =
            |method: &str, target: &str| String::from_utf8(page.answer(method, target)).unwrap();
        for target in ["/", "/index.html", "/?token=x", "/index.html#y"] {
            let answer = text("GET", target);
            assert!(answer.starts_with("HTTP/1.1 200 OK\r\n"), "{answer}");
            assert!(answer.contains("Content-Type: text/html"), "{answer}");
            assert!(answer.ends_with("\r\n\r\n<p>"), "{answer}");
        }
        assert!(text("GET", "/assets/a.js").contains("text/javascript"));
        assert!(text("HEAD", "/").ends_with("\r\n\r\n"));
        for target in [
            "/../Cargo.toml",
            "/assets/../index.html",
            "//etc/passwd",
            "/assets",
            "",
        ] {
            assert!(text("GET", target).starts_with("HTTP/1.1 404"), "{target}");
        }
        assert!(text("POST", "/").starts_with("HTTP/1.1 405"));
    }
}
