//! Frames know their sensor: whatever changes at the camera reaches the other
//! nodes with the very frame that it concerns.

mod harness;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use harness::{Bench, Peer, wait_until};
use modulo_core::Frame;
use modulo_runtime::sensor_info::SensorHistory;
use modulo_runtime::transport::Transport;
use modulo_runtime::{Message, MessageKind};

const ALPHAS: [&str; 4] = ["2.0", "3.0", "2.5", "4.0"];

/// While alpha changes 200 times at 30 Hz on a busy machine, each recovered frame equals the ideal
/// one of the same exposure. A frame that was unwrapped with the alpha of another
/// frame would differ: its scale, and most of its wraps, would be wrong.
#[test]
fn no_frame_is_unwrapped_with_the_alpha_of_another() {
    let bench = Bench::new();
    let source = "source:=scene://tunnel?seed=3&frames=100000";
    let camera = ["-p", source, "-p", "psf_sigma:=1.4", "-p", "rate:=30", "-p", "wait_for:=[unwrap]"];
    let _unwrap = bench.start(&["run", "unwrap"]);
    let peer = Peer::new(&bench);
    let [ideal, recovered] = ["/ideal", "/recovered"].map(|topic| peer.hear(topic, MessageKind::Image));
    let described = peer.hear("/sensor_info", MessageKind::Diagnostics);
    let running = bench.start(&[&["run", "modulo_camera", "--ros-args"][..], &camera].concat());
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));

    let loaded = Arc::new(AtomicBool::new(true));
    // The load lets frames and descriptions arrive late and in bursts, which is when they could be mixed up.
    for _ in 0..2 {
        let loaded = loaded.clone();
        std::thread::spawn(move || while loaded.load(Ordering::Relaxed) {});
    }
    let (mut ideals, mut recoveries) = (BTreeMap::<u64, Frame>::new(), BTreeMap::<u64, Frame>::new());
    let (mut sensors, mut alphas) = (SensorHistory::default(), BTreeMap::new());
    let mut compared = BTreeMap::new();
    // 200 changes, and on a slow machine more, until enough frames have been compared.
    let enough = |compared: &BTreeMap<_, i32>| compared.values().sum::<i32>() >= 60;
    for change in 0..2000 {
        if change >= 200 && enough(&compared) {
            break;
        }
        peer.set("/modulo_camera", "alpha", ALPHAS[change % ALPHAS.len()]).expect("possible");
        for (heard, frames) in [(&ideal, &mut ideals), (&recovered, &mut recoveries)] {
            while let Some(Message::Image(image)) = heard.next(Duration::from_millis(8)) {
                frames.insert(image.header.stamp.as_ns(), image.frame.clone());
            }
        }
        while let Some(Message::Diagnostics(info)) = described.next(Duration::ZERO) {
            sensors.note(&info).expect("a sensor");
            let alpha = sensors.of(info.header.stamp).expect("just taken").alpha;
            alphas.insert(info.header.stamp.as_ns(), alpha);
        }
        // Either of the two images may come first: a recovered one waits here for its ideal one.
        recoveries.retain(|stamp, frame| {
            let Some(expected) = ideals.remove(stamp) else { return true };
            let alpha = alphas[stamp];
            assert!(*frame == expected, "the frame of {stamp} ns, alpha {alpha}, differs");
            *compared.entry(alpha.to_string()).or_insert(0) += 1;
            false
        });
    }
    loaded.store(false, Ordering::Relaxed);
    drop(running);
    println!("compared frames by alpha: {compared:?}");
    assert_eq!(compared.len(), ALPHAS.len(), "{compared:?}");
    assert!(enough(&compared), "{compared:?}");
}
