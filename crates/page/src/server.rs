//! A server for one site on this machine: HTTP/1.1, GET and HEAD, a fixed set of files from memory.
//!
//! It stands on the standard library alone. What it has to do fits on a page, nothing of it changes from one year to the
//! next, and what it must not do (read files, follow paths, answer other machines) is easier to see here than in a
//! crate for servers.
//!
//! Web pages of strangers can make a browser ask 127.0.0.1, under a name of theirs (DNS rebinding) or from their own
//! origin. So a request is answered only when its `Host` is this server by address or as `localhost`, and answers say
//! that no other origin may read them.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::site::Site;

/// A request may have as many bytes before its body; what is longer is no browser's.
const LONGEST_HEAD: u64 = 16 * 1024;

/// Connections at a time; a page needs ten.
const MOST_CONNECTIONS: usize = 32;

/// Silence after which a connection ends.
const PATIENCE: Duration = Duration::from_secs(10);

/// A site on a port of 127.0.0.1.
pub struct Server {
    listener: TcpListener,
    site: Arc<Site>,
}

impl Server {
    /// Takes a port; 0 takes any that is free.
    ///
    /// # Errors
    /// What the system says, most often that the port is taken.
    pub fn bind(site: Site, port: u16) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        Ok(Self { listener, site: Arc::new(site) })
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
            let (site, open) = (Arc::clone(&self.site), Arc::clone(&open));
            std::thread::spawn(move || {
                // The same holds for one that goes away while it is answered.
                let _ = answer(&stream, &site, port);
                open.fetch_sub(1, Ordering::SeqCst);
            });
        }
        Ok(())
    }
}

/// Reads one request and answers it; the connection ends with the answer.
fn answer(stream: &TcpStream, site: &Site, port: u16) -> std::io::Result<()> {
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
    let reply = reply(&String::from_utf8_lossy(&head), site, port);
    let mut stream = stream;
    stream.write_all(&reply)?;
    stream.flush()
}

/// What a page of the site may do: show itself.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The answer to a request, head and body.
fn reply(request: &str, site: &Site, port: u16) -> Vec<u8> {
    let mut lines = request.lines();
    let mut words = lines.next().unwrap_or_default().split(' ');
    let (method, target, version) = (words.next(), words.next(), words.next());
    let (Some(method), Some(target), Some("HTTP/1.1" | "HTTP/1.0")) = (method, target, version) else {
        return refusal("400 Bad Request");
    };
    let mut hosts = lines.filter_map(|line| {
        let (name, value) = line.split_once(':')?;
        name.eq_ignore_ascii_case("host").then_some(value.trim())
    });
    let known = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let host = hosts.next().unwrap_or_default();
    if hosts.next().is_some() || !known.iter().any(|k| k.eq_ignore_ascii_case(host)) {
        return refusal("403 Forbidden");
    }
    if !matches!(method, "GET" | "HEAD") {
        return refusal("405 Method Not Allowed");
    }
    let path = target.split(['?', '#']).next().unwrap_or_default();
    let Some(file) = site.at(path) else { return refusal("404 Not Found") };
    let mut reply = format!(
        "HTTP/1.1 200 OK\r\ncontent-type: {}\r\ncontent-length: {}\r\ncache-control: no-store\r\n{}\
         content-security-policy: {POLICY}\r\nconnection: close\r\n\r\n",
        file.kind,
        file.bytes.len(),
        APART
    )
    .into_bytes();
    if method == "GET" {
        reply.extend_from_slice(&file.bytes);
    }
    reply
}

/// Other origins may neither read nor embed an answer, and nobody guesses its type.
const APART: &str = "x-content-type-options: nosniff\r\ncross-origin-resource-policy: same-origin\r\n\
                     cross-origin-opener-policy: same-origin\r\nreferrer-policy: no-referrer\r\n";

fn refusal(status: &str) -> Vec<u8> {
    format!(
        "HTTP/1.1 {status}\r\ncontent-type: text/plain\r\ncontent-length: {}\r\n{APART}connection: close\r\n\r\n{status}\n",
        status.len() + 1
    )
    .into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::testing::model;

    fn status(request: &str) -> String {
        let reply = reply(request, &Site::new(&model()), 4711);
        String::from_utf8_lossy(&reply).split("\r\n").next().expect("a line")["HTTP/1.1 ".len()..].to_owned()
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
    fn server_answers_over_a_socket_and_survives_those_who_hang_up() {
        let server = Server::bind(Site::new(&model()), 0).expect("a free port");
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
