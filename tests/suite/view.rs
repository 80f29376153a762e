//! `modulo view`: the page and its socket, used as a browser uses them.

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::Stdio;
use std::sync::{Mutex, mpsc};

use modulo_draw::class_colour;
use modulo_middleware::transport::zenoh::RawService;
use modulo_runtime::wire::keys::PARAMETER_QOS;
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

use crate::harness::{Background, Bench, Peer, assert_has, command_line, wait_until};

/// A suite at 5 Hz without end.
fn suite(bench: &Bench) -> Background {
    bench.images(4);
    let fixed = "source:=@/images model:=% engine:=rten rate:=5.0 loop:=true";
    bench.starts(&format!("launch launch/recovered.launch.yaml {fixed}"))
}

/// A viewer, and the address that it prints.
pub fn viewer(bench: &Bench) -> (Background, String) {
    let (viewer, [address]) = viewer_with(bench, &[], ["http://"]);
    (viewer, address)
}

/// A viewer with further arguments, and the addresses that it prints, one for each scheme.
fn viewer_with<const N: usize>(
    bench: &Bench,
    more: &[&str],
    schemes: [&str; N],
) -> (Background, [String; N]) {
    let arguments = [&["view", "--port", "0"], more].concat();
    let mut child = bench.modulo(&arguments).stdout(Stdio::piped()).spawn().expect("it starts");
    let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    let addresses = schemes.map(|scheme| {
        let line = lines.next().expect("a line for each address").expect("UTF-8");
        line.split(' ').find(|word| word.starts_with(scheme)).expect("an address").to_owned()
    });
    (Background(child), addresses)
}

/// The host and the token of an address.
pub fn parts(address: &str) -> (&str, &str) {
    let (host, token) = address.split_once("/?token=").expect("a token");
    (host.trim_start_matches("http://"), token)
}

/// Eight pages of suspended browsers kept all seats for ever.
#[test]
fn pages_that_stand_still_make_room_for_others() {
    let bench = Bench::new();
    let (_viewer, address) = viewer(&bench);
    let (host, token) = parts(&address);
    let connect = || tungstenite::connect(format!("ws://{host}/socket?token={token}"));
    // They are never read, and so answer no question.
    let still: Vec<_> = (0..8).map(|_| connect().expect("a seat")).collect();
    let refused = connect().expect_err("no seat is free").to_string();
    assert_has(&refused, &["503"]);
    wait_until("a seat is free", || connect().is_ok());
    drop(still);
}

struct Page(WebSocket<MaybeTlsStream<TcpStream>>);

impl Page {
    fn open(address: &str) -> Self {
        let (host, token) = parts(address);
        Self(tungstenite::connect(format!("ws://{host}/socket?token={token}")).expect("a connection").0)
    }

    fn ask(&mut self, request: &Value) {
        self.0.send(Message::text(request.to_string())).expect("sent");
    }

    /// The next event of `kind` that `accept` accepts. Images are drawn as they come.
    fn event(&mut self, kind: &str, accept: impl Fn(&Value) -> bool) -> Value {
        loop {
            match self.0.read().expect("a message") {
                Message::Text(text) => {
                    let event: Value = serde_json::from_str(&text).expect("JSON");
                    if let Some(body) = event.get(kind).filter(|body| accept(body)) {
                        return body.clone();
                    }
                }
                Message::Binary(bytes) => {
                    let images = images(&bytes);
                    let topics: Vec<&Value> = images.iter().map(|image| &image["topic"]).collect();
                    self.ask(&json!({ "drawn": topics }));
                    if let Some(image) = images.into_iter().find(|image| kind == "image" && accept(image)) {
                        return image;
                    }
                }
                _ => {}
            }
        }
    }
}

/// The facts that a message tells of its images, whose JPEG files must follow.
fn images(bytes: &[u8]) -> Vec<Value> {
    let (length, rest) = bytes.split_first_chunk().expect("a length");
    let (header, mut files) = rest.split_at(u32::from_le_bytes(*length) as usize);
    let header: Value = serde_json::from_slice(header).expect("JSON");
    let images = header["images"].as_array().expect("a list").clone();
    for image in &images {
        let (file, others) = files.split_at(image["bytes"].as_u64().expect("a length") as usize);
        assert!(file.starts_with(&[0xff, 0xd8]) && file.ends_with(&[0xff, 0xd9]), "a JPEG file");
        files = others;
    }
    assert!(files.is_empty(), "bytes behind the files");
    images
}

/// The kind of the step that a notice tells.
fn step(notice: &Value) -> String {
    let body = || notice["step"].as_object().and_then(|step| step.keys().next()).expect("a step");
    notice["step"].as_str().map_or_else(|| body().clone(), str::to_owned)
}

/// An image is shown by what its description says of it, whatever the name of its topic.
#[test]
fn a_page_is_told_what_the_samples_of_remapped_streams_mean() {
    let bench = Bench::new();
    bench.images(4);
    let share = env!("CARGO_MANIFEST_DIR");
    let file = format!(
        "launch:\n  - set_remap: {{ from: modulo, to: /x/recovered }}\n  - set_remap: {{ from: recovered, to: /x/modulo }}\n  - include: \
         {{ file: {share}/launch/recovered.launch.yaml }}\n"
    );
    std::fs::write(bench.path("remapped.launch.yaml"), file).expect("writable");
    let fixed = "source:=@/images model:=% engine:=rten rate:=5.0 loop:=true alpha:=2.0 headroom:=1.0";
    let _suite = bench.starts(&format!("launch @/remapped.launch.yaml {fixed}"));
    let (_viewer, address) = viewer(&bench);
    let mut page = Page::open(&address);
    page.ask(&json!({ "watch": ["/x/recovered", "/x/modulo"] }));
    for (topic, stream, peaks) in [("/x/recovered", "modulo", 1.0), ("/x/modulo", "recovered", 2.0)] {
        // Until the description has come, nobody knows the radiance.
        let image = page.event("image", |image| image["topic"] == topic && !image["peaks"].is_null());
        assert_eq!((&image["stream"], &image["peaks"]), (&json!(stream), &json!(peaks)), "{topic}");
    }
}

#[test]
fn a_page_shows_images_with_their_boxes_and_sets_parameters() {
    let bench = Bench::new();
    let _suite = suite(&bench);
    let (_viewer, address) = viewer(&bench);
    let mut page = Page::open(&address);
    let link =
        |from, to, topic| json!({ "from": from, "to": to, "topic": topic, "qos": "best effort, keep 5" });
    let links = [link("/modulo_camera", "/unwrap", "/modulo"), link("/unwrap", "/detector", "/recovered")];
    let graph = page.event("graph", |graph| {
        let all = graph["links"].as_array().expect("a list");
        links.iter().all(|link| all.contains(link))
    });
    assert_eq!(graph["detectors"][0]["inputs"], json!(["/recovered"]), "{graph}");
    let offers = graph["detectors"][0]["offers"].as_array().expect("a list");
    let offered = ["recovered", "auto", "/hdr"].map(|input| offers.contains(&json!(input)));
    assert_eq!(offered, [true, true, false], "{graph}");
    let mut steps = BTreeSet::new();
    while steps.len() < 3 {
        let notices = page.event("notices", |_| true);
        steps.extend(notices.as_array().expect("a list").iter().map(step));
    }
    let expected = ["detected", "sensed", "unwrapped"].map(str::to_owned);
    assert_eq!(steps, expected.into(), "each node tells its step");
    page.ask(&json!({ "watch": ["/modulo", "/recovered"] }));
    let image = page.event("image", |image| image["topic"] == "/recovered" && image["boxes"] != json!([]));
    assert_eq!((&image["width"], &image["height"]), (&json!(96), &json!(64)), "{image}");
    assert_eq!(image["boxes"][0][0], "/detector/detections");
    let peaks = image["peaks"].as_f64().expect("an image of radiance");
    assert!((peaks - 0.97 * 4.0).abs() < 1e-9, "headroom and alpha of the camera: {peaks}");
    let modulo = page.event("image", |image| image["topic"] == "/modulo");
    let asked =
        [("/modulo", &modulo["stamp"]), ("/recovered", &image["stamp"]), ("/recovered", &json!([1, 2]))];
    page.ask(&json!({ "pixel": { "u": 3, "v": 2, "images": asked } }));
    let pixel = page.event("pixel", |_| true);
    assert_eq!(pixel["samples"].as_array().map(Vec::len), Some(2), "the third has never come: {pixel}");
    for channel in 0..3 {
        let of = |kind: &str| pixel["samples"][1][kind][channel].as_f64().expect("three channels");
        assert!((of("radiance") - peaks * of("samples") / 255.0).abs() < 1e-6, "{pixel}");
    }

    let set = |page: &mut Page, value: &str| {
        page.ask(&json!({ "set": { "node": "/detector", "name": "input", "value": value } }));
        page.event("set", |_| true)
    };
    let refused = set(&mut page, "nonsense");
    assert!(refused["error"].as_str().is_some_and(|why| why.contains("one of")), "{refused}");
    assert_eq!(set(&mut page, "modulo")["error"], Value::Null);
    page.event("graph", |graph| graph["detectors"][0]["inputs"] == json!(["/modulo"]));
    page.event("image", |image| image["topic"] == "/modulo" && image["boxes"] != json!([]));
    page.ask(&json!({ "parameters": "/detector" }));
    let parameters = page.event("parameters", |_| true);
    let parameter = |name: &str| {
        let mut all = parameters["parameters"].as_array().expect("a list").iter();
        all.find(|parameter| parameter["name"] == name).expect("the parameter").clone()
    };
    assert_eq!(parameter("input")["value"], "modulo");
    assert!(parameter("engine")["words"].as_array().is_some_and(|words| words.contains(&json!("rten"))));
    assert_eq!(parameter("score_threshold")["range"], json!([0.0, 1.0]));
    assert_eq!(parameter("score_threshold")["default"], "0.25");

    for bad in [json!({ "watch": 5 }), json!({ "steer": "left" }), json!("nothing")] {
        page.ask(&bad);
        page.event("error", |why| why.as_str().is_some_and(|why| why.contains("unreadable request")));
    }
    page.ask(&json!({ "parameters": "/no_such_node" }));
    page.event("error", |why| why.as_str().is_some_and(|why| why.contains("/no_such_node")));
}

/// A replayed bag shows the boxes of the recorded detector on the images that it has read, and tells where it is. A viewer that is killed cannot
/// end its player.
#[test]
fn a_replayed_bag_has_its_boxes_and_its_time() {
    let bench = Bench::new();
    bench.images(4);
    let bag = bench.path("bag");
    let recording = bench.record(&bag, &["-a"]);
    bench.says(0, "launch launch/recovered.launch.yaml source:=@/images model:=% engine:=rten rate:=5.0 frames:=8 loop:=true");
    assert_eq!(recording.interrupt(), Some(0));
    let (viewer, [address]) = viewer_with(&bench, &[bag.to_str().expect("UTF-8")], ["http://"]);
    let mut page = Page::open(&address);
    page.ask(&json!({ "watch": ["/modulo", "/recovered"] }));
    let image = page.event("image", |image| image["topic"] == "/recovered" && image["boxes"] != json!([]));
    assert_eq!(image["boxes"][0][0], "/detector/detections");
    assert_eq!(page.event("image", |image| image["topic"] == "/modulo")["boxes"], json!([]));
    let is_player = |status: &Value| status["name"] == "rosbag2_player";
    let statuses = page.event("status", |all| all.as_array().is_some_and(|all| all.iter().any(is_player)));
    let status = statuses.as_array().and_then(|all| all.iter().find(|one| is_player(one))).expect("found");
    let second = |key: &str| {
        let value = status["values"].as_array().and_then(|all| all.iter().find(|one| one["key"] == key));
        value.and_then(|one| one["value"].as_str()?.parse::<f64>().ok()).expect("a number")
    };
    assert!((0.0..=second("duration_s")).contains(&second("position_s")), "{status}");
    page.ask(&json!({ "player": "toggle" }));
    page.event("player", |player| player["paused"] == true);
    page.ask(&json!({ "drawn": ["/modulo", "/recovered"] }));
    let middle = second("start_s") + second("duration_s") / 2.0;
    page.ask(&json!({ "player": { "seek": [middle, 100] } }));
    // Images from before may still be on the way, and the answer may come behind those of the middle.
    page.event("image", |image| image["stamp"][0].as_f64().is_some_and(|stamp| (stamp - middle).abs() < 1.0));
    let [(player, _)] = viewer.children()[..] else { panic!("a player alone") };
    drop(viewer);
    wait_until("the player has ended", || command_line(player).is_empty());
}

/// The response to a request of HTTP that begins with `head`, as text.
pub fn request(host: &str, head: &str) -> String {
    let mut stream = TcpStream::connect(host).expect("a connection");
    write!(stream, "{head}\r\nHost: {host}\r\nConnection: close\r\n\r\n").expect("sent");
    let mut response = String::new();
    stream.read_to_string(&mut response).expect("a response");
    response
}

#[test]
fn only_the_holder_of_the_token_is_served() {
    let bench = Bench::new();
    let (viewer, address) = viewer(&bench);
    let (host, token) = parts(&address);
    let page = request(host, "GET / HTTP/1.1");
    assert_has(&page, &["HTTP/1.1 200", "content-security-policy: default-src 'none'"]);
    assert!(!page.contains(token), "the page is for everybody");
    let refusal = |path: &str, origin: Option<&str>| {
        let mut request = format!("ws://{host}{path}").into_client_request().expect("a request");
        if let Some(origin) = origin {
            request.headers_mut().insert("origin", origin.parse().expect("a header"));
        }
        match tungstenite::connect(request) {
            Ok(_) => None,
            Err(tungstenite::Error::Http(response)) => Some(response.status().as_u16()),
            Err(why) => panic!("{why}"),
        }
    };
    assert_eq!(refusal("/socket", None), Some(401));
    assert_eq!(refusal("/socket?token=0123456789abcdef", None), Some(401));
    let right = format!("/socket?token={token}");
    assert_eq!(refusal(&right, Some("http://elsewhere.example")), Some(403), "a page of another place");
    assert_eq!(refusal(&right, Some(&format!("http://{host}"))), None);
    assert_eq!(refusal(&right, None), None);
    // The page asks for the reason, which a browser hides from it.
    for (path, origin, reason) in [
        ("/socket?token=0123456789abcdef", "https://robot.example.com", "401 The token is missing or wrong"),
        (&*right, "https://robot.example.com", "403 `proxy_set_header Host $http_host;`"),
        (&right, &format!("http://{host}"), "426 Upgrade and Connection"),
        ("/modulo/", "", "404 `proxy_pass`"),
    ] {
        let response =
            request(host, &format!("POST {path} HTTP/1.1\r\nOrigin: {origin}\r\nContent-Length: 0"));
        let (status, sentence) = reason.split_once(' ').expect("two parts");
        assert_has(&response, &[&format!("HTTP/1.1 {status} "), "content-type: text/plain", sentence]);
    }
    // Port and token are checked before anything is opened.
    bench.ends(1, &["view", "--port", host.rsplit_once(':').expect("a port").1]);
    bench.says(2, "view --token short");
    assert_eq!(viewer.interrupt(), Some(0), "SIGINT ends it");
}

#[test]
fn a_recording_is_a_page_with_the_images_and_what_was_told() {
    let bench = Bench::new();
    let _suite = suite(&bench);
    let out = bench.path("out.html");
    let (viewer, [address]) = viewer_with(&bench, &["--record", out.to_str().expect("UTF-8")], ["http://"]);
    // A browser at the same time sees when there is something to record.
    let mut page = Page::open(&address);
    page.event("graph", |graph| !graph["detectors"].as_array().is_none_or(Vec::is_empty));
    page.ask(&json!({ "watch": ["/recovered"] }));
    for _ in 0..3 {
        page.event("image", |image| image["boxes"] != json!([]));
        page.event("status", |_| true);
    }
    assert_eq!(viewer.interrupt(), Some(0), "SIGINT ends it");
    let text = std::fs::read_to_string(&out).expect("a file");
    let recording = text.split("id=\"recording\">").nth(1).and_then(|rest| rest.split("</script>").next());
    let recording: Vec<(f64, Value)> = serde_json::from_str(recording.expect("a recording")).expect("JSON");
    let expected = |kind: &str| recording.iter().filter(|(_, body)| body.get(kind).is_some()).count();
    assert_eq!(expected("graph"), 1, "the last one");
    assert!(expected("parameters") >= 3 && expected("notices") > 0 && expected("status") > 0);
    assert!(recording.iter().any(|(_, body)| body.is_string()), "images");
    assert!(!text.contains("src=\"") && !text.contains("href=\"page.css"), "it loads nothing");
    bench.says(2, "view --record /no/folder/out.html");
}

/// A client of the Foxglove WebSocket protocol.
struct Foxglove {
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    /// All channels that it was offered.
    channels: Vec<Value>,
    /// All warnings and errors that it was told.
    warnings: Vec<String>,
}

impl Foxglove {
    fn open(address: &str) -> Self {
        let mut request = address.into_client_request().expect("an address");
        let protocol = "foxglove.sdk.v1".parse().expect("a header");
        request.headers_mut().insert("sec-websocket-protocol", protocol);
        let socket = tungstenite::connect(request).expect("a connection").0;
        Self { socket, channels: Vec::new(), warnings: Vec::new() }
    }

    fn ask(&mut self, request: &Value) {
        self.socket.send(Message::text(request.to_string())).expect("sent");
    }

    /// The next text message of `op` that `accept` accepts.
    fn hear(&mut self, op: &str, accept: impl Fn(&Value) -> bool) -> Value {
        loop {
            if let Message::Text(text) = self.socket.read().expect("a message") {
                let message: Value = serde_json::from_str(&text).expect("JSON");
                self.channels.extend(message["channels"].as_array().into_iter().flatten().cloned());
                if message["op"] == "status" {
                    self.warnings.push(message["message"].to_string());
                }
                if message["op"] == op && accept(&message) {
                    return message;
                }
            }
        }
    }

    /// The id of the channel of `topic`, which must have this schema.
    fn channel(&mut self, topic: &str, schema: &str) -> Value {
        loop {
            if let Some(channel) = self.channels.iter().find(|channel| channel["topic"] == topic) {
                let kind = (&channel["schemaName"], &channel["encoding"]);
                assert_eq!(kind, (&json!(schema), &json!("protobuf")));
                return channel["id"].clone();
            }
            self.hear("advertise", |_| true);
        }
    }

    /// The next message of the subscription `id`.
    fn message(&mut self, id: u32) -> Vec<u8> {
        loop {
            if let Message::Binary(bytes) = self.socket.read().expect("a message")
                // Opcode, id of the subscription, and time.
                && let Some((1, [a, b, c, d, rest @ ..])) = bytes.split_first().map(|(op, rest)| (*op, rest))
                && u32::from_le_bytes([*a, *b, *c, *d]) == id
            {
                return rest[8..].to_vec();
            }
        }
    }

    /// The value of a parameter; `None` where there is none.
    fn parameter(&mut self, name: &str) -> Option<Value> {
        self.ask(&json!({ "op": "getParameters", "parameterNames": [name], "id": name }));
        let values = self.hear("parameterValues", |message| message["id"] == name);
        values["parameters"].as_array().expect("a list").first().map(|first| first["value"].clone())
    }

    /// Sets a parameter, and returns what it has then.
    fn set(&mut self, name: &str, value: &str) -> Value {
        let parameters = json!([{ "name": name, "value": value }]);
        self.ask(&json!({ "op": "setParameters", "parameters": parameters, "id": "set" }));
        self.hear("parameterValues", |message| message["id"] == "set")["parameters"][0]["value"].clone()
    }
}

#[test]
fn foxglove_gets_images_with_boxes_and_sets_parameters_with_the_token() {
    let bench = Bench::new();
    let _suite = suite(&bench);
    let (viewer, [page, address]) = viewer_with(&bench, &["--foxglove", "0"], ["http://", "ws://"]);
    let mut client = Foxglove::open(&address);
    let server = client.hear("serverInfo", |_| true);
    assert!(
        server["capabilities"].as_array().is_some_and(|all| all.contains(&json!("parameters"))),
        "{server}"
    );
    let image = client.channel("/recovered", "foxglove.CompressedImage");
    let boxes = client.channel("/detector/detections", "foxglove.ImageAnnotations");
    let subscriptions = json!([{ "id": 1, "channelId": image }, { "id": 2, "channelId": boxes }]);
    client.ask(&json!({ "op": "subscribe", "subscriptions": subscriptions }));
    assert!(client.message(1).windows(3).any(|part| part == [0xff, 0xd8, 0xff]), "a JPEG file");
    assert!(!client.message(2).is_empty(), "boxes");

    assert_eq!(client.parameter("/detector.input"), Some(json!("recovered")));
    assert_eq!(client.parameter("/detector.score_threshold"), Some(json!(0.25)));
    assert_eq!(client.parameter("/no_such_node.input"), None);
    assert_eq!(client.set("/detector.input", "modulo"), "recovered", "no token was given");
    assert_eq!(client.set("token", "0123456789abcdef"), "");
    assert_eq!(client.set("/detector.input", "modulo"), "recovered", "a wrong token was given");
    assert_eq!(client.set("token", parts(&page).1), "", "the token is never told");
    assert_eq!(client.set("/detector.input", "modulo"), "modulo");
    let mut other = Foxglove::open(&address);
    assert_eq!(other.set("/detector.input", "recovered"), "modulo", "each client gives the token");
    assert_eq!(viewer.interrupt(), Some(0), "SIGINT ends it");
}

/// Any web page may ask; each question that waits for a node takes a thread.
#[test]
fn foxglove_refuses_requests_when_too_many_wait_for_a_node() {
    const REQUESTS: usize = 12;
    let (bench, (give, forever)) = (Bench::new(), mpsc::channel::<()>());
    let (peer, forever) = (Peer::new(&bench), Mutex::new(forever));
    let service = |name, ros_type, answer| RawService { name, ros_type, qos: PARAMETER_QOS, answer };
    let stalled = service(
        "get_parameters",
        "rcl_interfaces/srv/GetParameters",
        Box::new(move |_: &[u8]| {
            // Until the end of the test.
            let _ = forever.lock().map(|end| end.recv());
            Ok(Vec::new())
        }),
    );
    let listed =
        service("list_parameters", "rcl_interfaces/srv/ListParameters", Box::new(|_: &[u8]| Ok(Vec::new())));
    let _services = peer.transport.serve_raw(&peer.node_name, vec![stalled, listed]).expect("services");
    let (_viewer, [_page, address]) = viewer_with(&bench, &["--foxglove", "0"], ["http://", "ws://"]);
    let mut client = Foxglove::open(&address);
    let warned = |client: &mut Foxglove| {
        client.ask(&json!({ "op": "getParameters", "parameterNames": ["/peer.x"], "id": "first" }));
        client.hear("parameterValues", |_| true);
        std::mem::take(&mut client.warnings)
    };
    // Before the viewer knows the node, it answers without asking it.
    wait_until("the viewer asks the node", || !warned(&mut client).is_empty());
    for id in 0..REQUESTS {
        client.ask(&json!({ "op": "getParameters", "parameterNames": ["/peer.x"], "id": id.to_string() }));
    }
    for _ in 0..REQUESTS {
        client.hear("parameterValues", |_| true);
    }
    let refused = client.warnings.iter().filter(|why| why.contains("too many requests")).count();
    assert_eq!((refused, client.warnings.len()), (REQUESTS - 8, REQUESTS), "{:?}", client.warnings);
    drop(give);
}

/// The demonstration as one picture of what its nodes have published: the normal camera clips the sun, and the recovered image shows it.
#[test]
fn the_demo_is_a_picture_of_three_images() {
    let bench = Bench::new();
    assert_eq!(bench.says(0, "demo --image @/demo.png").lines().count(), 1);
    let picture = image::open(bench.path("demo.png")).expect("a picture").to_rgb8();
    let height = picture.height() / 3;
    let white = |third: u32| {
        // Below the line with the name of the stream.
        let rows = third * height + 30..(third + 1) * height;
        let pixels = rows.flat_map(|y| (0..picture.width()).map(move |x| (x, y)));
        pixels.filter(|&(x, y)| picture.get_pixel(x, y).0 == [255; 3]).count()
    };
    assert!(white(0) > 20_000 && white(2) < 2_000, "{} {}", white(0), white(2));
    let cars = |third: u32| {
        let pixels =
            picture.enumerate_pixels().filter(|(.., pixel)| **pixel == image::Rgb(class_colour("car")));
        pixels.filter(|(_, y, _)| y / height == third).count()
    };
    assert!(cars(2) > cars(0), "{} {}", cars(2), cars(0));
    assert!(bench.says(2, "demo --image @/no/demo.png").contains("no/demo.png"));
    assert!(bench.says(2, "view @/no_bag").contains("no_bag"));
}

/// The demonstration as a page, which ends with all its processes.
#[test]
fn the_demo_is_a_page_with_both_images() {
    let bench = Bench::new();
    let mut child = bench.modulo(&["demo", "--port", "0"]).stdout(Stdio::piped()).spawn().expect("it starts");
    let lines = BufReader::new(child.stdout.take().expect("piped")).lines().map(|line| line.expect("UTF-8"));
    let demo = Background(child);
    let address = lines.flat_map(|line| line.split(' ').map(str::to_owned).collect::<Vec<_>>());
    let address = address.into_iter().find(|word| word.starts_with("http://")).expect("an address");
    let (address, choice) = address.split_once('&').expect("a token");
    assert!(choice.starts_with("layout=wipe&left=/saturated&right=/recovered"), "{choice}");
    let mut page = Page::open(address);
    page.ask(&json!({ "watch": ["/saturated", "/recovered"] }));
    for topic in ["/saturated", "/recovered"] {
        page.event("image", |image| image["topic"] == topic && image["boxes"] != json!([]));
    }
    let launch = demo.children();
    assert!(matches!(&launch[..], [(_, line)] if line.contains("launch demo.launch.yaml")), "{launch:?}");
    assert_eq!(demo.interrupt(), Some(0));
    assert_eq!(command_line(launch[0].0), "", "the suite has ended, too");
}

/// A demonstration that is killed cannot end its suite.
#[test]
fn the_suite_of_a_killed_demo_ends_by_itself() {
    let bench = Bench::new();
    let mut child = bench.modulo(&["demo", "--port", "0"]).stdout(Stdio::piped()).spawn().expect("it starts");
    // The address is told after the suite was started.
    let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    let demo = Background(child);
    assert!(lines.any(|line| line.expect("UTF-8").contains("http://")));
    let [(launch, _)] = demo.children()[..] else { panic!("a launch alone") };
    drop(demo);
    wait_until("the suite has ended", || command_line(launch).is_empty());
}
