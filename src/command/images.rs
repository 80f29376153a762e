//! `modulo simulate`, `modulo unwrap` and `modulo eval stability`: the unwrapping methods on images.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use modulo_camera::CameraParameters;
use modulo_core::Transfer;
use modulo_draw::distinct;
use modulo_eval::below_100;
use modulo_eval::images::recover::{UnwrapRequest, unwrap_files};
use modulo_eval::images::runner::{Row, RunOutcome, median};
use modulo_eval::images::simulate::{self as simulation, SimulationRequest};
use modulo_eval::stability::{self, Judgement, Trial};
use modulo_images::WHITE_PERCENTILE;
use modulo_runtime::output::ResultFolder;
use modulo_runtime::sensor::options::CHIP;

use super::eval::with_progress;
use super::usage;
use crate::{Ended, Failure};

#[derive(Args)]
pub struct Simulate {
    /// Parameter file of the camera with the values of the chip and the lens, such as sensors/mosaic.yaml
    #[arg(long = "sensor", value_name = "FILE", conflicts_with = CHIP)]
    sensor_file: Option<PathBuf>,
    #[command(flatten)]
    request: SimulationRequest,
}

/// Sends image files through the sensor and the methods.
pub fn simulate(args: Simulate) -> Result<Ended, Failure> {
    let Simulate { sensor_file, mut request } = args;
    if let Some(file) = sensor_file {
        request.sensor.take_chip(&CameraParameters::read_sensor(&file).map_err(usage)?);
    }
    Ok(report(&with_progress(|tell| simulation::simulate(&request, tell))?))
}

pub fn unwrap(request: &UnwrapRequest) -> Result<Ended, Failure> {
    let outcome = with_progress(|tell| unwrap_files(request, tell))?;
    let ended = report(&outcome);
    if outcome.rows.iter().any(|row| row.sensor.transfer == Transfer::Linear) {
        note!(
            "hint: the pictures show radiance linearly, which is dark on a screen; --transfer srgb shows it as people see it"
        );
    }
    Ok(ended)
}

/// Runs the methods on the scenes of the stability suite.
pub fn stability(out: Option<&Path>) -> Result<Ended, Failure> {
    let folder = ResultFolder::take(out, "stability", None).map_err(usage)?;
    let trials = with_progress(|tell| stability::run(folder.path(), tell))?;
    say!("{:<18} scenes recovered trusted wrongly", "method");
    for method in distinct(trials.iter().map(|trial| trial.row.method.as_str())) {
        let own = trials.iter().filter(|trial| trial.row.method == method);
        let (recovered, others): (Vec<_>, Vec<_>) = own.partition(|trial| trial.is_recovered());
        let (count, all) = (recovered.len(), recovered.len() + others.len());
        let [trusted, wrongly] =
            [recovered, others].map(|trials| trials.iter().filter(|trial| trial.is_trusted()).count());
        say!("{method:<18} {all:>6} {count:>9} {trusted:>7} {wrongly:>7}");
    }
    let (held, others): (Vec<&Trial>, Vec<_>) =
        trials.iter().partition(|trial| trial.verdict == Judgement::Held);
    let (better, broken): (Vec<&Trial>, Vec<_>) =
        others.into_iter().partition(|trial| trial.verdict == Judgement::Better);
    better.iter().for_each(|trial| say!("better than expected: {}", trial.what()));
    broken.iter().for_each(|trial| say!("worse than expected: {}", trial.what()));
    say!("{} expectations held, {} broke", held.len(), broken.len());
    note!("results and pictures: {}", folder.path().display());
    Ok(Ended::of(!broken.is_empty()))
}

/// Prints the results of a command.
fn report(outcome: &RunOutcome) -> Ended {
    let white = |row: &Row| Some((row.file.clone(), row.simulated.as_ref()?.white?));
    let mut whites: Vec<_> = outcome.rows.iter().filter_map(white).collect();
    whites.dedup();
    whites
        .iter()
        .for_each(|(file, white)| say!("white is {white}, the {WHITE_PERCENTILE}th percentile of {file}"));
    print_rows(&outcome.rows);
    print_methods(&outcome.rows);
    note!("results: {}", outcome.folder.display());
    Ended::of(!outcome.skipped.is_empty())
}

/// Columns of the name of a file.
const NAME: usize = 20;

/// Prints a line of at most 100 columns for each image, sensor and method, and then why results are not trusted. Only a simulation knows
/// the truth.
fn print_rows(rows: &[Row]) {
    let is_simulated = rows.iter().any(|row| row.simulated.is_some());
    let titles = if is_simulated { "   exact k   PSNR dB   SSIM" } else { "" };
    say!("{:<NAME$} alpha {:<20}{titles} trusted  k up to       ms", "file", "method: used");
    let mut reasons: Vec<&str> = Vec::new();
    for row in rows {
        let file = Path::new(&row.file).file_name().unwrap_or_default().to_string_lossy();
        let truth = row.simulated.as_ref().map_or_else(String::new, |simulated| {
            let psnr = simulated.psnr_db.map_or("inf".to_owned(), |db| format!("{db:.2}"));
            let ssim = simulated.ssim.map_or("-".to_owned(), |ssim| format!("{ssim:.4}"));
            format!(" {:>8}% {psnr:>9} {ssim:>6}", below_100(simulated.exact_k, 3))
        });
        let method = match row.method_used == row.method {
            true => row.method.clone(),
            false => format!("{}: {}", row.method, row.method_used),
        };
        let trusted = match (row.trusted, row.reason) {
            (None, _) => "-".to_owned(),
            (Some(true), _) => "yes".to_owned(),
            (Some(false), reason) => {
                let reason = reason.unwrap_or("the method does not say why");
                let known = reasons.iter().position(|known| *known == reason);
                let number = known.unwrap_or_else(|| {
                    reasons.push(reason);
                    reasons.len() - 1
                });
                format!("no ({})", number + 1)
            }
        };
        let (alpha, most_k, ms) = (row.sensor.alpha, row.most_k, row.ms);
        say!("{:<NAME$} {alpha:>5} {method:<20}{truth} {trusted:<7} {most_k:>8} {ms:>8.2}", tail(&file));
    }
    (1..).zip(&reasons).for_each(|(number, reason)| say!("({number}) not trusted: {reason}"));
}

/// Returns a name that is too long for its column by its end, which tells the files of a folder apart.
fn tail(name: &str) -> String {
    let length = name.chars().count();
    if length <= NAME {
        return name.to_owned();
    }
    format!("~{}", name.chars().skip(length + 1 - NAME).collect::<String>())
}

/// Prints a line for each method and alpha over all images, where there are several.
fn print_methods(rows: &[Row]) {
    let mut groups: BTreeMap<_, Vec<&Row>> = BTreeMap::new();
    for row in rows {
        // The bits of positive numbers have the order of the numbers.
        groups.entry((row.sensor.alpha.to_bits(), &row.method)).or_default().push(row);
    }
    if groups.values().all(|rows| rows.len() < 2) {
        return;
    }
    say!("\nimages alpha method           mean exact k trusted ms median");
    for ((alpha, method), rows) in groups {
        let count = rows.len();
        let exact: Option<f64> = rows.iter().map(|row| Some(row.simulated.as_ref()?.exact_k)).sum();
        let exact = exact.map_or("-".to_owned(), |sum| format!("{}%", below_100(sum / count as f64, 3)));
        let trusted = rows.iter().filter(|row| row.trusted == Some(true)).count();
        let ms = median(rows.iter().map(|row| row.ms).collect());
        say!("{count:>6} {:>5} {method:<16} {exact:>12} {trusted:>7} {ms:>9.2}", f64::from_bits(alpha));
    }
}
