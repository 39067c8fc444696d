//! The gate: an access check in front of the WebSocket servers of Foxglove's SDK, which accept every web page and wait
//! forever for a handshake. Browsers send the origin of the connecting page in the header `Origin`; other programs send
//! none. The gate admits allowed origins, and requests without an origin. Requests whose query has the access token
//! (`ws://HOST:PORT/?token=TOKEN`) are passed to the server for operators, all others to the server for watchers.
//! Requests without a WebSocket upgrade get a file of the cockpit's page.
//!
//! Messages of clients are held back while a topic is being advertised (`advertisements.rs`).
//!
//! The SDK (0.30) has no hook for any of this. Its servers listen on random loopback addresses and ports, 2^40
//! possibilities, too many for a web page to search, so that the gate cannot be bypassed.

use std::collections::BTreeSet;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt, copy};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::timeout;

use super::advertisements::Advertisements;
use super::page::Page;

/// Longest time from connection to complete request.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// Largest request \[bytes\].
const LARGEST_REQUEST: usize = 16 << 10;
/// Maximum number of simultaneous connections.
const CONNECTIONS: usize = 64;

/// Origins of web pages that may connect: those on this computer, and configured ones.
#[derive(Debug, Clone)]
pub struct Origins(Vec<String>);

impl Origins {
    /// Origins such as `https://app.foxglove.dev`; `*` allows all.
    pub fn new(configured: &[String]) -> Self {
        let plain = |origin: &String| origin.trim_end_matches('/').to_ascii_lowercase();
        Self(configured.iter().map(plain).collect())
    }

    fn allow(&self, origin: &str) -> bool {
        let origin = origin.trim().trim_end_matches('/').to_ascii_lowercase();
        self.0.iter().any(|o| *o == "*" || *o == origin) || is_local(&origin)
    }
}

fn is_local(origin: &str) -> bool {
    let host = ["http://", "https://"]
        .iter()
        .find_map(|scheme| origin.strip_prefix(scheme));
    let Some(host) = host else { return false };
    let host = match host.rsplit_once(':') {
        Some((host, port)) if port.bytes().all(|b| b.is_ascii_digit()) => host,
        _ => host,
    };
    ["localhost", "127.0.0.1", "[::1]"].contains(&host)
}

/// A random loopback address for a server behind the gate.
pub fn hidden_address() -> SocketAddr {
    let [a, b, c]: [u8; 3] = rand::random();
    // Neither the network address nor the broadcast address.
    SocketAddr::from((Ipv4Addr::new(127, a, b, c.clamp(1, 254)), 0))
}

/// Listens on `address`.
///
/// # Errors
/// If it cannot be bound.
pub fn listen(address: SocketAddr) -> io::Result<std::net::TcpListener> {
    let listener = std::net::TcpListener::bind(address)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// Destinations of the gate.
pub struct Routes {
    /// The server for clients that only watch.
    pub watchers: SocketAddr,
    /// The server for clients that may operate, if there is one.
    pub operators: Option<Entry>,
    /// Origins of web pages that may connect.
    pub origins: Origins,
    /// Advertisements in progress on both servers.
    pub advertisements: Advertisements,
}

/// Access for operators.
pub struct Entry {
    /// Address of their server.
    pub server: SocketAddr,
    /// The access token.
    pub token: String,
    /// The cockpit's page.
    pub page: Page,
}

impl Routes {
    /// The server for a request with the access token `given`.
    fn server(&self, given: Option<&str>) -> SocketAddr {
        match (&self.operators, given) {
            (Some(entry), Some(given)) if is_same(given, &entry.token) => entry.server,
            _ => self.watchers,
        }
    }
}

/// Compares secrets in constant time.
fn is_same(a: &str, b: &str) -> bool {
    let differ = a.bytes().zip(b.bytes()).fold(0, |d, (a, b)| d | (a ^ b));
    a.len() == b.len() && differ == 0
}

/// Serves connections accepted by `listener` until its runtime ends.
pub async fn pass(listener: std::net::TcpListener, routes: Routes) {
    match TcpListener::from_std(listener) {
        Ok(listener) => Gate::new(routes, HANDSHAKE).run(listener).await,
        Err(e) => tracing::error!("Foxglove: cannot listen: {e}"),
    }
}

struct Gate {
    routes: Routes,
    handshake: Duration,
    /// Refused origins and invalid tokens, each reported once.
    reported: Mutex<BTreeSet<String>>,
}

impl Gate {
    fn new(routes: Routes, handshake: Duration) -> Arc<Self> {
        Arc::new(Self {
            routes,
            handshake,
            reported: Mutex::default(),
        })
    }

    async fn run(self: Arc<Self>, listener: TcpListener) {
        let places = Arc::new(Semaphore::new(CONNECTIONS));
        loop {
            let Ok((client, _)) = listener.accept().await else {
                // For example, there is no free file descriptor.
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            };
            // Above the maximum number of connections, the connection is closed.
            if let Ok(place) = Arc::clone(&places).try_acquire_owned() {
                let gate = Arc::clone(&self);
                tokio::spawn(async move {
                    // An error ends this connection only.
                    let _ = gate.serve(client).await;
                    drop(place);
                });
            }
        }
    }

    async fn serve(&self, mut client: TcpStream) -> io::Result<()> {
        let Ok(request) = timeout(self.handshake, request(&mut client)).await else {
            return Ok(());
        };
        let request = request?;
        if !request.is_upgrade
            && let Some(entry) = &self.routes.operators
        {
            let answer = entry.page.answer(&request.method, &request.target);
            return timeout(self.handshake, client.write_all(&answer))
                .await
                .unwrap_or(Ok(()));
        }
        let allowed = &self.routes.origins;
        if let Some(origin) = request.origins.iter().find(|o| !allowed.allow(o)) {
            self.report(origin);
            let answer =
                b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
            return client.write_all(answer).await;
        }
        let mut server = TcpStream::connect(self.server(&request)).await?;
        client.set_nodelay(true)?;
        server.set_nodelay(true)?;
        server.write_all(&request.bytes).await?;
        self.copy(&mut client, &mut server).await
    }

    /// Copies bytes in both directions until both ends have closed the connection, or one fails.
    async fn copy(&self, client: &mut TcpStream, server: &mut TcpStream) -> io::Result<()> {
        let (mut from_client, mut to_client) = client.split();
        let (mut from_server, mut to_server) = server.split();
        let requests = async {
            let mut bytes = vec![0; 8 << 10];
            loop {
                let n = from_client.read(&mut bytes).await?;
                if n == 0 {
                    return to_server.shutdown().await;
                }
                self.routes.advertisements.complete().await;
                to_server.write_all(&bytes[..n]).await?;
            }
        };
        let answers = async {
            copy(&mut from_server, &mut to_client).await?;
            to_client.shutdown().await
        };
        tokio::try_join!(requests, answers)?;
        Ok(())
    }

    fn server(&self, request: &Request) -> SocketAddr {
        let token = request.token();
        let server = self.routes.server(token);
        if token.is_some() && server == self.routes.watchers && self.is_new("a wrong token") {
            tracing::warn!("Foxglove: a client has no valid access token: it may only watch");
        }
        server
    }

    /// Whether something has not been reported yet.
    fn is_new(&self, what: &str) -> bool {
        /// Maximum number of stored reports.
        const REPORTS: usize = 100;
        let mut reported = (self.reported.lock()).unwrap_or_else(PoisonError::into_inner);
        reported.len() < REPORTS && reported.insert(what.to_owned())
    }

    fn report(&self, origin: &str) {
        if self.is_new(origin) {
            tracing::warn!(
                "Foxglove: refused the web page {origin:?}; the parameter allowed_origins of the node foxglove allows others than those on this computer"
            );
        }
    }
}

/// The first bytes of a connection, at least its HTTP request.
struct Request {
    bytes: Vec<u8>,
    method: String,
    target: String,
    /// Whether it asks for a WebSocket.
    is_upgrade: bool,
    origins: Vec<String>,
}

impl Request {
    fn token(&self) -> Option<&str> {
        let (_, query) = self.target.split_once('?')?;
        query
            .split('&')
            .find_map(|pair| pair.strip_prefix("token="))
    }
}

async fn request(client: &mut TcpStream) -> io::Result<Request> {
    let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    let mut bytes = Vec::new();
    loop {
        if client.read_buf(&mut bytes).await? == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let mut headers = [httparse::EMPTY_HEADER; 64];
        let mut parsed = httparse::Request::new(&mut headers);
        match parsed.parse(&bytes) {
            Ok(httparse::Status::Complete(_)) => {
                let origins = (parsed.headers.iter())
                    .filter(|h| h.name.eq_ignore_ascii_case("origin"))
                    .map(|h| String::from_utf8_lossy(h.value).into_owned())
                    .collect();
                let is_upgrade =
                    (parsed.headers.iter()).any(|h| h.name.eq_ignore_ascii_case("upgrade"));
                let text = |part: Option<&str>| part.unwrap_or_default().to_owned();
                let (method, target) = (text(parsed.method), text(parsed.path));
                return Ok(Request {
                    bytes,
                    method,
                    target,
                    is_upgrade,
                    origins,
                });
            }
            Ok(httparse::Status::Partial) if bytes.len() < LARGEST_REQUEST => {}
            Ok(httparse::Status::Partial) => return Err(invalid("a request that is too long")),
            Err(e) => return Err(invalid(&e.to_string())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpStream as Client;
    use std::time::Instant;

    #[test]
    fn pages_on_this_computer_and_configured_ones_are_allowed() {
        let origins = Origins::new(&["https://app.foxglove.dev".to_owned(), "file://".to_owned()]);
        for origin in [
            "http://localhost",
            "http://localhost:8080",
            "https://LOCALHOST:1",
            "http://127.0.0.1:3000",
            "http://[::1]:3000",
            "https://app.foxglove.dev",
            "file://",
        ] {
            assert!(origins.allow(origin), "{origin}");
        }
        for origin in [
            "https://evil.example",
            "http://localhost.evil.example",
            "http://localhost:80@evil.example",
            "http://127.0.0.1.evil.example:80",
            "https://app.foxglove.dev.evil.example",
            "null",
            "",
        ] {
            assert!(!origins.allow(origin), "{origin}");
        }
        assert!(Origins::new(&["*".to_owned()]).allow("https://evil.example"));
    }

    /// A server that answers every request with its bytes, after `mark`; its address.
    fn echo(runtime: &tokio::runtime::Runtime, mark: &'static str) -> SocketAddr {
        let server = listen(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
        let address = server.local_addr().unwrap();
        runtime.spawn(async move {
            let server = TcpListener::from_std(server).unwrap();
            while let Ok((mut client, _)) = server.accept().await {
                let mut bytes = vec![0; 4096];
                let n = client.read(&mut bytes).await.unwrap();
                client.write_all(mark.as_bytes()).await.unwrap();
                client.write_all(&bytes[..n]).await.unwrap();
            }
        });
        address
    }

    /// A gate before such a server, with one for operators if there is a `token`; the gate's address.
    fn gate(runtime: &tokio::runtime::Runtime, token: Option<&str>) -> SocketAddr {
        let _entered = runtime.enter();
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("index.html"), "<p>").unwrap();
        let operators = token.map(|token| Entry {
            server: echo(runtime, "operators: "),
            token: token.to_owned(),
            page: Page::of(folder.path()).unwrap(),
        });
        let routes = Routes {
            watchers: echo(runtime, ""),
            operators,
            origins: Origins::new(&[]),
            advertisements: Advertisements::new(),
        };
        start(runtime, routes)
    }

    /// Starts a gate; its address.
    fn start(runtime: &tokio::runtime::Runtime, routes: Routes) -> SocketAddr {
        let _entered = runtime.enter();
        let listener = listen(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
        let public = listener.local_addr().unwrap();
        let gate = Gate::new(routes, Duration::from_millis(500));
        let listener = TcpListener::from_std(listener).unwrap();
        runtime.spawn(gate.run(listener));
        public
    }

    fn answer(address: SocketAddr, request: &str) -> String {
        let mut client = Client::connect(address).unwrap();
        client.write_all(request.as_bytes()).unwrap();
        client
            .set_read_timeout(Some(Duration::from_secs(5)))
            .unwrap();
        let mut text = String::new();
        // The gate may reset a connection that it refuses.
        let _ = client.read_to_string(&mut text);
        text
    }

    #[test]
    fn other_pages_are_refused_and_slow_clients_are_disconnected() {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        let address = gate(&runtime, None);
        let with = |header: &str| format!("GET / HTTP/1.1\r\nHost: x\r\n{header}\r\n");
        for header in ["", "Origin: http://localhost:1\r\n"] {
            let request = with(header);
            assert_eq!(answer(address, &request), request);
        }
        for header in [
            "Origin: https://evil.example\r\n",
            "oRIGIN: https://evil.example\r\n",
            "Origin: http://localhost\r\nOrigin: https://evil.example\r\n",
        ] {
            assert!(
                answer(address, &with(header)).starts_with("HTTP/1.1 403"),
                "{header}"
            );
        }
        let endless = with(&format!("X: {}", "x".repeat(100_000)));
        assert_eq!(answer(address, &endless), "");
        // Neither silence nor a byte now and then keeps a connection.
        let start = Instant::now();
        assert_eq!(answer(address, "GET / HT"), "");
        assert!(start.elapsed() < Duration::from_secs(3));
        let mut client = Client::connect(address).unwrap();
        let closed = (0..100).any(|_| {
            std::thread::sleep(Duration::from_millis(50));
            client.write_all(b"x").is_err()
        });
        assert!(closed);
    }

    #[test]
    fn the_access_token_leads_to_the_operators_server_and_browsers_get_the_page() {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        let address = gate(&runtime, Some("secret"));
        let ask = |target: &str, headers: &str| {
            let request = format!("GET {target} HTTP/1.1\r\nHost: x\r\n{headers}\r\n");
            answer(address, &request)
        };
        let socket = "Upgrade: websocket\r\n";
        for target in ["/?token=secret", "/?a=b&token=secret", "/x?token=secret&c"] {
            assert!(
                ask(target, socket).starts_with("operators: GET"),
                "{target}"
            );
        }
        for target in [
            "/",
            "/?token=",
            "/?token=secre",
            "/?token=secret0",
            "/?token=Secret",
            "/?atoken=secret",
            "/token=secret",
        ] {
            assert!(ask(target, socket).starts_with("GET"), "{target}");
        }
        // The token does not help a foreign page.
        let foreign = format!("{socket}Origin: https://evil.example\r\n");
        assert!(ask("/?token=secret", &foreign).starts_with("HTTP/1.1 403"));
        assert!(ask("/", "").ends_with("\r\n\r\n<p>"));
        assert!(ask("/Cargo.toml", "").starts_with("HTTP/1.1 404"));
    }

    // Fails if a subscription reaches the server before the server knows that it has advertised the topic.
    #[test]
    fn what_a_client_sends_waits_while_a_topic_is_advertised() {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let advertisements = Advertisements::new();
        let routes = Routes {
            watchers: listener.local_addr().unwrap(),
            operators: None,
            origins: Origins::new(&[]),
            advertisements: advertisements.clone(),
        };
        let mut client = Client::connect(start(&runtime, routes)).unwrap();
        let request = b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n";
        client.write_all(request).unwrap();
        let (mut server, _) = listener.accept().unwrap();
        let mut bytes = [0; 100];
        server.read_exact(&mut bytes[..request.len()]).unwrap();
        let short = Some(Duration::from_millis(200));
        server.set_read_timeout(short).unwrap();
        advertisements.during(|| {
            server.write_all(b"advertised").unwrap();
            client.read_exact(&mut bytes[..10]).unwrap();
            client.write_all(b"subscribe").unwrap();
            assert!(server.read(&mut bytes).is_err(), "it came too early");
        });
        server.set_read_timeout(None).unwrap();
        server.read_exact(&mut bytes[..9]).unwrap();
        assert_eq!(&bytes[..9], b"subscribe");
        // The end of the one is the end of the other.
        drop(client);
        assert_eq!(server.read(&mut bytes).unwrap(), 0);
    }
}
