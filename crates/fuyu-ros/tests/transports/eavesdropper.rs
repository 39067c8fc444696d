//! Somebody between a session and its router who keeps all bytes, and sends them again.

use std::{
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    sync::{Arc, Mutex},
    thread,
    time::Duration,
};

/// Passes on what connections send to a router and back.
pub struct Eavesdropper {
    port: u16,
    router: u16,
    state: Arc<State>,
}

#[derive(Default)]
struct State {
    /// What the sessions have sent, in the order of arrival.
    heard: Mutex<Vec<u8>>,
    /// The router's end of the last connection.
    to_router: Mutex<Option<TcpStream>>,
}

impl Eavesdropper {
    /// In front of the router at this port of loopback.
    pub fn start(router: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let port = listener.local_addr().expect("it is bound").port();
        let state = Arc::new(State::default());
        // Ends with the tests.
        thread::spawn({
            let state = Arc::clone(&state);
            move || {
                for session in listener.incoming().flatten() {
                    let Ok(to_router) = TcpStream::connect(("127.0.0.1", router)) else {
                        continue;
                    };
                    pass_on(session, to_router, &state);
                }
            }
        });
        Self {
            port,
            router,
            state,
        }
    }

    /// Where sessions connect to.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// What sessions have sent so far, once they are silent.
    pub fn heard(&self) -> Vec<u8> {
        thread::sleep(Duration::from_millis(100));
        self.state.heard.lock().unwrap().clone()
    }

    /// Sends bytes over a connection of its own, until the router closes it.
    pub fn send_again(&mut self, bytes: &[u8]) {
        let mut own = TcpStream::connect(("127.0.0.1", self.router)).expect("the router listens");
        // The router may close it before all is sent.
        let _ = own.write_all(bytes);
        let mut answer = Vec::new();
        own.set_read_timeout(Some(Duration::from_secs(30)))
            .expect("it can be set");
        match own.read_to_end(&mut answer) {
            Err(e) if e.kind() != std::io::ErrorKind::ConnectionReset => panic!("not closed: {e}"),
            _ => {}
        }
    }

    /// Sends bytes to the router within the last connection.
    pub fn insert(&mut self, bytes: &[u8]) {
        let mut to_router = self.state.to_router.lock().unwrap();
        let to_router = to_router.as_mut().expect("a session is connected");
        to_router.write_all(bytes).expect("the connection is open");
    }
}

fn pass_on(session: TcpStream, to_router: TcpStream, state: &Arc<State>) {
    let (mut from_session, mut from_router) = (
        session.try_clone().expect("a descriptor"),
        to_router.try_clone().expect("a descriptor"),
    );
    *state.to_router.lock().unwrap() = Some(to_router.try_clone().expect("a descriptor"));
    let state = Arc::clone(state);
    let (mut to_session, mut to_router) = (session, to_router);
    thread::spawn(move || {
        let mut buffer = [0; 65_536];
        while let Ok(count @ 1..) = from_session.read(&mut buffer) {
            let bytes = &buffer[..count];
            state.heard.lock().unwrap().extend(bytes);
            if to_router.write_all(bytes).is_err() {
                break;
            }
        }
        let _ = to_router.shutdown(std::net::Shutdown::Both);
    });
    thread::spawn(move || {
        let mut buffer = [0; 65_536];
        while let Ok(count @ 1..) = from_router.read(&mut buffer) {
            if to_session.write_all(&buffer[..count]).is_err() {
                break;
            }
        }
        let _ = to_session.shutdown(std::net::Shutdown::Both);
    });
}
