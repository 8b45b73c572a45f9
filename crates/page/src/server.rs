//! A server for one site on this machine: HTTP/1.1, GET and HEAD, files from memory; and for the page of a bake its events
//! and the one wish that it takes, to stop.
//!
//! It stands on the standard library alone. What it has to do fits on a page, nothing of it changes from one year to the
//! next, and what it must not do (read files, follow paths, answer other machines) is easier to see here than in a
//! crate for servers.
//!
//! Web pages of strangers can make a browser ask 127.0.0.1, under a name of theirs (DNS rebinding) or from their own
//! origin. So a request is answered only when its `Host` is this server by address or as `localhost`, and answers say
//! that no other origin may read them. The wish to stop is taken only from a page of this server, by its `Origin`, which
//! browsers send with every POST.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::live::{CANCEL, EVENTS, Live};
use crate::site::File;

/// A request may have as many bytes before its body; what is longer is no browser's.
const LONGEST_HEAD: u64 = 16 * 1024;

/// Connections at a time; a page needs ten.
const MOST_CONNECTIONS: usize = 32;

/// Silence after which a connection ends.
const PATIENCE: Duration = Duration::from_secs(10);

/// A site on a port of 127.0.0.1.
pub struct Server {
    listener: TcpListener,
    live: Arc<Live>,
}

impl Server {
    /// Takes a port; 0 takes any that is free.
    ///
    /// # Errors
    /// What the system says, most often that the port is taken.
    pub fn bind(live: Arc<Live>, port: u16) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        Ok(Self { listener, live })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// What the system says.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Answers requests until the process ends.
    ///
    /// # Errors
    /// When the listener breaks.
    pub fn run(&self) -> std::io::Result<()> {
        let port = self.address()?.port();
        let open = Arc::new(AtomicUsize::new(0));
        for stream in self.listener.incoming() {
            // A client that went away before it was answered is no reason to stop.
            let Ok(stream) = stream else { continue };
            if open.fetch_add(1, Ordering::SeqCst) >= MOST_CONNECTIONS {
                open.fetch_sub(1, Ordering::SeqCst);
                continue;
            }
            let (live, open) = (Arc::clone(&self.live), Arc::clone(&open));
            std::thread::spawn(move || {
                // The same holds for one that goes away while it is answered.
                let _ = answer(&stream, &live, port);
                open.fetch_sub(1, Ordering::SeqCst);
            });
        }
        Ok(())
    }
}

/// Reads one request and answers it; the connection ends with the answer.
fn answer(stream: &TcpStream, live: &Live, port: u16) -> std::io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut head = Vec::new();
    let mut lines = BufReader::new(stream).take(LONGEST_HEAD);
    loop {
        let before = head.len();
        if lines.read_until(b'\n', &mut head)? == 0 || matches!(&head[before..], b"\r\n" | b"\n") {
            break;
        }
    }
    let mut stream = stream;
    match reply(&String::from_utf8_lossy(&head), live, port) {
        Reply::Whole(head, file) => live.answer(|| {
            stream.write_all(&head)?;
            stream.write_all(file.as_ref().map_or(&[], |file| &file.bytes))?;
            stream.flush()
        }),
        Reply::Events(head) => {
            stream.write_all(&head)?;
            live.stream(stream)
        }
    }
}

/// What a request is answered with.
enum Reply {
    /// All of it: what stands before the file, and the file, if it is sent.
    Whole(Vec<u8>, Option<Arc<File>>),
    /// What stands before the events of a bake.
    Events(Vec<u8>),
}

/// What a page of the site may do: show itself.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The answer to a request.
fn reply(request: &str, live: &Live, port: u16) -> Reply {
    let mut lines = request.lines();
    let mut words = lines.next().unwrap_or_default().split(' ');
    let (method, target, version) = (words.next(), words.next(), words.next());
    let (Some(method), Some(target), Some("HTTP/1.1" | "HTTP/1.0")) = (method, target, version) else {
        return refusal("400 Bad Request");
    };
    let values = |wanted: &str| -> Vec<&str> {
        let fields = lines.clone().filter_map(|line| line.split_once(':'));
        fields.filter(|(name, _)| name.eq_ignore_ascii_case(wanted)).map(|(_, value)| value.trim()).collect()
    };
    let known = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let is_own = |host: &str| known.iter().any(|k| k.eq_ignore_ascii_case(host));
    if !matches!(values("host")[..], [host] if is_own(host)) {
        return refusal("403 Forbidden");
    }
    let path = target.split(['?', '#']).next().unwrap_or_default();
    if method == "POST" && live.takes(path, CANCEL) {
        let from_own_page = |origin: &&str| origin.strip_prefix("http://").is_some_and(is_own);
        if !matches!(values("origin")[..], [origin] if from_own_page(&origin)) {
            return refusal("403 Forbidden");
        }
        live.cancel();
        return refusal("202 Accepted");
    }
    if !matches!(method, "GET" | "HEAD") {
        return refusal("405 Method Not Allowed");
    }
    if method == "GET" && live.takes(path, EVENTS) {
        return Reply::Events(head("text/event-stream", None));
    }
    let Some(file) = live.file(path) else {
        return if live.is_past(path) { past() } else { refusal("404 Not Found") };
    };
    Reply::Whole(head(file.kind, Some(file.bytes.len())), (method == "GET").then_some(file))
}

/// The head of an answer that is given.
fn head(kind: &str, length: Option<usize>) -> Vec<u8> {
    let length = length.map_or(String::new(), |length| format!("content-length: {length}\r\n"));
    format!(
        "HTTP/1.1 200 OK\r\ncontent-type: {kind}\r\n{length}cache-control: no-store\r\n{APART}\
         content-security-policy: {POLICY}\r\nconnection: close\r\n\r\n"
    )
    .into_bytes()
}

/// Other origins may neither read nor embed an answer, and nobody guesses its type.
const APART: &str = "x-content-type-options: nosniff\r\ncross-origin-resource-policy: same-origin\r\n\
                     cross-origin-opener-policy: same-origin\r\nreferrer-policy: no-referrer\r\n";

/// An answer that is its status.
fn refusal(status: &str) -> Reply {
    let text = format!(
        "HTTP/1.1 {status}\r\ncontent-type: text/plain\r\ncontent-length: {}\r\n{APART}connection: close\r\n\r\n{status}\n",
        status.len() + 1
    );
    Reply::Whole(text.into_bytes(), None)
}

/// The answer to a page that is late. It is no error: the page goes on with the names of newer blocks.
fn past() -> Reply {
    Reply::Whole(
        format!("HTTP/1.1 204 No Content\r\ncache-control: no-store\r\n{APART}connection: close\r\n\r\n")
            .into(),
        None,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Site;
    use crate::model::testing::model;

    fn still() -> Live {
        Live::still(Site::new(&model()))
    }

    fn status_of(request: &str, live: &Live) -> String {
        let (Reply::Whole(reply, _) | Reply::Events(reply)) = reply(request, live, 4711);
        String::from_utf8_lossy(&reply).split("\r\n").next().expect("a line")["HTTP/1.1 ".len()..].to_owned()
    }

    fn status(request: &str) -> String {
        status_of(request, &still())
    }

    #[test]
    fn server_answers_this_machine() {
        for host in ["127.0.0.1:4711", "localhost:4711", "LOCALHOST:4711"] {
            assert_eq!(status(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n")), "200 OK");
        }
        assert_eq!(status("GET /model.json?now HTTP/1.1\r\nhost:127.0.0.1:4711\r\n\r\n"), "200 OK");
    }

    #[test]
    fn server_refuses_other_hosts() {
        let hosts = [
            "evil.example",
            "evil.example:4711",
            "127.0.0.1",
            "127.0.0.1:80",
            "127.0.0.1:4711.evil.example",
            "",
        ];
        for host in hosts {
            assert_eq!(status(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n")), "403 Forbidden", "{host}");
        }
        assert_eq!(status("GET / HTTP/1.1\r\n\r\n"), "403 Forbidden");
        let two = "GET / HTTP/1.1\r\nHost: 127.0.0.1:4711\r\nHost: evil.example\r\n\r\n";
        assert_eq!(status(two), "403 Forbidden");
    }

    #[test]
    fn server_has_no_way_out_of_the_site() {
        let paths = [
            "/../Cargo.toml",
            "/..%2f..%2fetc/passwd",
            "/%2e%2e/x",
            "//etc/passwd",
            "http://evil.example/",
            "*",
            "\\",
        ];
        for path in paths {
            let request = format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:4711\r\n\r\n");
            assert_eq!(status(&request), "404 Not Found", "{path}");
        }
    }

    #[test]
    fn server_takes_nothing_but_questions() {
        for method in ["POST", "PUT", "DELETE", "OPTIONS"] {
            let request = format!("{method} / HTTP/1.1\r\nHost: 127.0.0.1:4711\r\n\r\n");
            assert_eq!(status(&request), "405 Method Not Allowed");
        }
        for nonsense in ["", "GET", "GET /", "\0\0\0", "GET / HTTP/9"] {
            assert_eq!(status(nonsense), "400 Bad Request");
        }
    }

    #[test]
    fn server_takes_the_wish_to_stop_from_its_own_page_alone() {
        let live = Live::of_bake();
        let post = |path: &str, origin: &str, live: &Live| {
            status_of(&format!("POST {path} HTTP/1.1\r\nHost: 127.0.0.1:4711\r\n{origin}\r\n"), live)
        };
        let own = "Origin: http://127.0.0.1:4711\r\n";
        let others = [
            "",
            "Origin: null\r\n",
            "Origin: http://evil.example\r\n",
            "Origin: https://127.0.0.1:4711\r\n",
            "Origin: http://127.0.0.1:80\r\n",
            "Origin: http://127.0.0.1:4711\r\nOrigin: http://evil.example\r\n",
        ];
        for origin in others {
            assert_eq!(post("/cancel", origin, &live), "403 Forbidden", "{origin}");
        }
        assert_eq!(post("/other", own, &live), "405 Method Not Allowed");
        assert_eq!(post("/cancel", own, &still()), "405 Method Not Allowed");
        assert_eq!(status_of("GET /cancel HTTP/1.1\r\nHost: 127.0.0.1:4711\r\n\r\n", &live), "404 Not Found");
        assert!(!live.is_cancelled());
        assert_eq!(post("/cancel", own, &live), "202 Accepted");
        assert!(live.is_cancelled());
    }

    #[test]
    fn server_tells_a_late_page_that_its_block_is_past() {
        let live = Live::of_bake();
        let status =
            |name: &str| status_of(&format!("GET /{name} HTTP/1.1\r\nHost: 127.0.0.1:4711\r\n\r\n"), &live);
        assert_eq!(status("light-1.bin"), "404 Not Found");
        (0..3).for_each(|_| live.publish(&model()));
        assert_eq!(
            ["light-1.bin", "light-2.bin", "light-3.bin", "light-4.bin"].map(status),
            ["204 No Content", "200 OK", "200 OK", "404 Not Found"]
        );
    }

    #[test]
    fn server_streams_events_until_the_page_is_closed() {
        let live = Arc::new(Live::of_bake());
        let server = Server::bind(Arc::clone(&live), 0).expect("a free port");
        let address = server.address().expect("bound");
        std::thread::spawn(move || server.run());
        let stream = TcpStream::connect(address).expect("listens");
        stream.set_read_timeout(Some(Duration::from_secs(20))).expect("set");
        write!(&stream, "GET /events HTTP/1.1\r\nHost: localhost:{}\r\n\r\n", address.port()).expect("sent");
        let mut lines = BufReader::new(&stream).lines().map(|line| line.expect("an answer"));
        assert!(lines.any(|line| line == "content-type: text/event-stream"));
        assert!(lines.any(|line| line.contains(r#""version":0"#)));
        live.publish(&model());
        assert!(lines.any(|line| line.starts_with("data: ") && line.contains(r#""version":1"#)));
        drop(lines);
        drop(stream);
        let since = std::time::Instant::now();
        while live.pages() > 0 {
            assert!(since.elapsed() < Duration::from_secs(20));
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    #[test]
    fn server_answers_over_a_socket_and_survives_those_who_hang_up() {
        let server = Server::bind(Arc::new(still()), 0).expect("a free port");
        let address = server.address().expect("bound");
        assert!(address.ip().is_loopback());
        std::thread::spawn(move || server.run());
        drop(TcpStream::connect(address).expect("listens"));
        let mut stream = TcpStream::connect(address).expect("listens");
        let port = address.port();
        write!(stream, "HEAD /main.js HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n").expect("sent");
        let mut text = String::new();
        stream.read_to_string(&mut text).expect("answered");
        assert!(text.starts_with("HTTP/1.1 200 OK\r\n") && text.ends_with("\r\n\r\n"), "{text}");
        assert!(
            text.contains("cross-origin-resource-policy: same-origin") && text.contains("text/javascript")
        );
        // More than a head may have.
        let mut stream = TcpStream::connect(address).expect("listens");
        let _ = stream.write_all(&vec![b'a'; 2 * LONGEST_HEAD as usize]);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.is_empty() || answer.starts_with(b"HTTP/1.1 400"));
    }
}
