//! The page in a real browser without a screen, driven by `chromedriver`.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use robot_tests::serving::{await_motion, serve, stopped_after};
use serde_json::{Value, json};

const TOKEN: &str = "0123456789abcdef0123456789abcdef";
/// From the click to motors without current, microseconds of virtual time.
const STOP_US: u64 = 250_000;

/// A browser behind `chromedriver` (`WebDriver` of the W3C).
struct Browser {
    driver: Child,
    port: u16,
    session: String,
}

impl Drop for Browser {
    fn drop(&mut self) {
        let session = std::mem::take(&mut self.session);
        let _ = http(
            self.port,
            "DELETE",
            &format!("/session/{session}"),
            &Value::Null,
        );
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// One request; the value of the answer.
fn http(port: u16, method: &str, path: &str, body: &Value) -> std::io::Result<Value> {
    let mut stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_read_timeout(Some(Duration::from_mins(1)))?;
    let body = if body.is_null() {
        String::new()
    } else {
        body.to_string()
    };
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\
         Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    )?;
    let mut head = Vec::new();
    let mut byte = [0];
    while !head.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte)?;
        head.push(byte[0]);
    }
    let head = String::from_utf8_lossy(&head).to_ascii_lowercase();
    let length = head
        .lines()
        .find_map(|line| line.strip_prefix("content-length:"));
    let length = length
        .and_then(|length| length.trim().parse().ok())
        .unwrap_or(0);
    let mut answer = vec![0; length];
    stream.read_exact(&mut answer)?;
    let answer: Value = serde_json::from_slice(&answer)?;
    Ok(answer["value"].clone())
}

impl Browser {
    /// None where there is no `chromedriver`.
    fn new() -> Option<Self> {
        let port = std::net::TcpListener::bind("127.0.0.1:0")
            .ok()?
            .local_addr()
            .ok()?
            .port();
        let driver = Command::new("chromedriver")
            .arg(format!("--port={port}"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut browser = Self {
            driver,
            port,
            session: String::new(),
        };
        let options = json!({ "args": ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"] });
        let wanted =
            json!({ "capabilities": { "alwaysMatch": { "goog:chromeOptions": options } } });
        let ends = Instant::now() + Duration::from_mins(1);
        while browser.session.is_empty() {
            assert!(Instant::now() < ends, "no session with chromedriver");
            std::thread::sleep(Duration::from_millis(100));
            if let Ok(value) = http(port, "POST", "/session", &wanted) {
                browser.session = value["sessionId"].as_str().unwrap_or_default().into();
            }
        }
        Some(browser)
    }

    fn open(&self, url: &str) {
        let path = format!("/session/{}/url", self.session);
        http(self.port, "POST", &path, &json!({ "url": url })).expect("the browser answers");
    }

    /// The value of a script's `return`.
    fn script(&self, script: &str) -> Value {
        let path = format!("/session/{}/execute/sync", self.session);
        let body = json!({ "script": script, "args": [] });
        http(self.port, "POST", &path, &body).expect("the browser answers")
    }

    /// Waits until a script returns true.
    fn until(&self, condition: &str) {
        let ends = Instant::now() + Duration::from_mins(1);
        while self.script(&format!("return {condition};")) != Value::Bool(true) {
            let text = self.script("return document.body.innerText;");
            assert!(Instant::now() < ends, "{condition}: {text}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

// Requirement: SERVE-client-3, SERVE-client-4, SERVE-drive-1, SERVE-map-1
#[test]
#[ignore = "needs chromedriver: the gate `page` runs it"]
fn page_shows_map_and_stops_the_wheels() {
    let browser = Browser::new().expect("chromedriver (apt install chromium-driver)");
    serve(|hub, board| {
        let url = pilot::web::serve("127.0.0.1:0", &TOKEN.into(), hub).expect("a free port");
        let (page, _) = url.split_once('#').expect("a token");

        // A wrong token, and a page from elsewhere, get nothing.
        browser.open(&format!("{page}#{}", TOKEN.replace('0', "1")));
        std::thread::sleep(Duration::from_secs(2));
        let nothing = "return document.body.dataset.timeUs === undefined && document.getElementById('pose').textContent === '';";
        assert_eq!(browser.script(nothing), Value::Bool(true));
        browser.open("data:text/html,<title>elsewhere</title>");
        let socket = page.replacen("http", "ws", 1);
        browser.script(&format!(
            "window.got = []; const s = new WebSocket('{socket}socket'); \
             s.onopen = () => {{ got.push('open'); s.send(JSON.stringify({{do: 'hello', version: 1, name: 'x', token: '{TOKEN}'}})); }}; \
             s.onmessage = (e) => got.push(e.data); s.onclose = () => got.push('closed');"
        ));
        browser.until("window.got.length > 0");
        assert_eq!(browser.script("return window.got.join();"), "closed");

        browser.open(&url);
        browser.until("document.getElementById('connection').textContent === 'connected'");
        browser.script("document.getElementById('explore').click();");
        browser.until("document.getElementById('state').textContent.includes('explore')");
        await_motion(board);
        // A robot that stands maps nothing; each of these is a tile that changed.
        browser.until("Number(document.getElementById('map').dataset.updates) > 3");
        await_motion(board);
        // The time of the latest frame that the page knows is before the click.
        let script = "const t = document.body.dataset.timeUs; document.body.dispatchEvent(new KeyboardEvent(\
                      'keydown', {key: ' ', bubbles: true})); return Number(t);";
        let clicked_us = browser.script(script).as_u64().expect("a time");
        let after_us = stopped_after(board, clicked_us);
        println!("wheels stop {after_us} us after the page's latest frame before the click");
        assert!(after_us <= STOP_US, "{after_us} us");
        browser
            .until("document.getElementById('connection').textContent.includes('stopped by page')");
        browser.script("document.getElementById('explore').click();");
        await_motion(board);
        browser.script("document.getElementById('stop').click();");
        browser
            .until("document.getElementById('connection').textContent.includes('stopped by page')");
        // What is clicked is what was drawn there, and a tile's first row is drawn lowest.
        let script = "let sent; const was = send, v = view(); send = (request) => sent = request; \
                      canvas.onclick({ offsetX: v.x(-200), offsetY: v.y(300) }); send = was; \
                      const tile = draw({ cells: '#'.padEnd(1024) }).image.getContext('2d'); \
                      const at = (y) => tile.getImageData(0, y, 1, 1).data[0]; \
                      return [sent.do, Math.round(sent.x_mm), Math.round(sent.y_mm), at(31), at(0)].join();";
        assert_eq!(browser.script(script), "goto,-200,300,20,136");
    });
}
