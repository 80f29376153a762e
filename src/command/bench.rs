//! `modulo simulate`, `modulo bench` and `modulo stability`: what the methods do with pictures.

use std::path::Path;

use anyhow::anyhow;
use indicatif::{ProgressBar, ProgressStyle};
use modulo_bench::{Event, bench, frontier, simulate, stability};

use crate::cli::bench::{Bench, BenchUnwrap, Simulate};
use crate::{Ended, Failure};

/// Sends pictures through the sensor and the methods.
pub fn simulate(args: &Simulate) -> Result<Ended, Failure> {
    let request = simulate::Request {
        files: args.images.clone(),
        out: args.out.clone(),
        alphas: args.alpha.clone(),
        methods: args.method.clone(),
        psf: args.sensor.psf.of_sigma(args.sensor.psf_sigma),
        bits: args.sensor.bits,
        read_noise: args.sensor.read_noise,
        seed: args.sensor.seed,
        white: args.white,
    };
    let progress = Progress::new();
    let outcome = simulate::simulate(&request, &mut |event| progress.tell(event))?;
    progress.end();
    say!(
        "{:<28} {:>5} {:<16} {:>8} {:>9} {:>8} {:<14} {:<7} {:>8}",
        "file",
        "alpha",
        "method",
        "exact k",
        "PSNR dB",
        "SSIM",
        "rung",
        "trusted",
        "ms"
    );
    for row in &outcome.rows {
        let number =
            |value: Option<f64>, digits| value.map_or("-".into(), |value| format!("{value:.digits$}"));
        let file = Path::new(&row.file).file_name().unwrap_or_default().to_string_lossy();
        let trusted = row.trusted.map_or("-", |trusted| if trusted { "yes" } else { "no" });
        say!(
            "{file:<28} {:>5} {:<16} {:>7.3}% {:>9} {:>8} {:<14} {trusted:<7} {:>8.2}",
            row.alpha,
            row.method,
            100.0 * row.exact_k,
            number(row.psnr_db, 2),
            number(row.ssim, 4),
            row.rung,
            row.ms
        );
    }
    Ok(if outcome.skipped.is_empty() { Ended::Done } else { Ended::WithLoss })
}

/// Measures the methods, or draws what was measured.
pub fn bench(command: &Bench) -> Result<Ended, Failure> {
    match command {
        Bench::Unwrap(args) => bench_unwrap(args),
        Bench::Chart { folder } => {
            for file in frontier::draw_frontier(&folder.join(bench::RESULTS))? {
                say!("{}", file.display());
            }
            Ok(Ended::Done)
        }
    }
}

fn bench_unwrap(args: &BenchUnwrap) -> Result<Ended, Failure> {
    let all = bench::Request::default();
    let request = bench::Request {
        frames: args.frames.clone(),
        out: args.out.clone(),
        methods: if args.method.is_empty() { all.methods } else { args.method.clone() },
        alphas: args.alpha.clone(),
        psf: args.sensor.psf.of_sigma(args.sensor.psf_sigma),
        threads: args.threads.clone(),
        repeats: args.repeats,
        device: processor(),
        bits: args.sensor.bits,
        read_noise: args.sensor.read_noise,
        seed: args.sensor.seed,
    };
    let progress = Progress::new();
    let outcome = bench::unwrap(&request, &mut |event| progress.tell(event))?;
    progress.end();
    say!(
        "{:<16} {:>5} {:>7} {:>9} {:>9} {:>9}",
        "method",
        "alpha",
        "threads",
        "ms p50",
        "exact k",
        "PSNR dB"
    );
    for row in &outcome.rows {
        let psnr = row.psnr_db.map_or("-".into(), |psnr| format!("{psnr:.2}"));
        say!(
            "{:<16} {:>5} {:>7} {:>9.2} {:>8.3}% {psnr:>9}",
            row.method,
            row.alpha,
            row.threads,
            row.ms_p50,
            100.0 * row.exact_k
        );
    }
    for file in frontier::draw_frontier(&args.out.join(bench::RESULTS))? {
        say!("{}", file.display());
    }
    Ok(if outcome.skipped.is_empty() { Ended::Done } else { Ended::WithLoss })
}

/// Runs the scenes on which methods fail.
pub fn stability(out: &Path) -> Result<Ended, Failure> {
    let progress = Progress::new();
    let outcome = stability::run(out, |event| progress.tell(event))?;
    progress.end();
    outcome.better.iter().for_each(|what| say!("better than documented: {what}"));
    outcome.broken.iter().for_each(|what| say!("broken: {what}"));
    let (held, broken) = (outcome.held, outcome.broken.len());
    say!("{held} expectations held, {broken} broke");
    say!("{}", out.join("index.html").display());
    if broken > 0 { Err(anyhow!("{broken} expectations broke").into()) } else { Ok(Ended::Done) }
}

/// The processor's model from `/proc/cpuinfo`, else its architecture.
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    match model {
        Some((_, name)) => name.split_whitespace().collect::<Vec<_>>().join(" "),
        None => std::env::consts::ARCH.to_owned(),
    }
}

/// A bar on a terminal, nothing elsewhere; what went wrong goes to standard error in any case.
struct Progress(ProgressBar);

impl Progress {
    fn new() -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {eta} {msg}") {
            bar.set_style(style);
        }
        Self(bar)
    }

    fn tell(&self, event: Event<'_>) {
        match event {
            Event::Step { done, total, next } => {
                self.0.set_length(total as u64);
                self.0.set_position(done as u64);
                self.0.set_message(next.to_owned());
            }
            Event::Skipped(skipped) => self.0.suspend(|| eprintln!("modulo: skipped: {}", skipped.why)),
            Event::Warning(warning) => self.0.suspend(|| eprintln!("modulo: {warning}")),
        }
    }

    fn end(&self) {
        self.0.finish_and_clear();
    }
}
