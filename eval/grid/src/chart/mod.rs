//! The charts of a grid, one file each. Pure: results in, [`Chart`] out.

mod alpha;
mod frontier;
mod histogram;
mod latency;
mod paper;
pub(crate) mod pictures;

use modulo_charts::{Body, Chart, ChartError, Page};

pub use pictures::Shot;

use crate::results::Results;
use crate::wording::{self, Conditions, distinct};

/// A chart and the name of its files, without extension.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// Such as `frontier_alpha4_psf1.4_noise0`.
    pub name: String,
    /// What is drawn.
    pub chart: Chart,
}

/// A chart as SVG, for a desk and for a phone.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// Of the [`Named`].
    pub name: String,
    /// Of the chart.
    pub title: String,
    /// [`Page::Wide`].
    pub wide: String,
    /// [`Page::Narrow`].
    pub narrow: String,
}

impl Named {
    /// A chart whose subtitle says what `results` were measured on and with.
    fn new(name: String, title: String, results: &Results, footer: String, body: Body) -> Self {
        Self { name, chart: Chart { title, subtitle: subtitle(results), footer, body } }
    }

    /// Both forms.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn draw(&self) -> Result<Drawn, ChartError> {
        let (wide, narrow) = (self.chart.svg(Page::Wide)?, self.chart.svg(Page::Narrow)?);
        Ok(Drawn { name: self.name.clone(), title: self.chart.title.clone(), wide, narrow })
    }
}

/// All charts that the cells of `results` allow, those of the first conditions first.
pub fn all(results: &Results) -> Vec<Named> {
    let conditions = wording::all_conditions(&results.cells);
    let each = |draw: fn(&Results, Conditions) -> Vec<Named>| {
        conditions.iter().flat_map(|conditions| draw(results, *conditions)).collect::<Vec<_>>()
    };
    [
        each(frontier::charts),
        each(alpha::charts),
        each(paper::charts),
        each(latency::charts),
        each(histogram::charts),
    ]
    .concat()
}

/// Counts, engine and device.
fn subtitle(results: &Results) -> String {
    let objects = results.cells.first().map(|cell| &cell.objects);
    let objects = objects.into_iter().flatten().map(|(group, n)| format!("{n} {group}")).collect::<Vec<_>>();
    let counted = |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    let devices = distinct(results.cells.iter().map(|cell| {
        let device = &cell.device;
        let threads = counted(device.threads, "thread an inference", "threads an inference");
        let jobs = counted(device.jobs, "frame at a time", "frames at a time");
        format!("{} on {}, {threads}, {jobs}", device.engine, device.processor)
    }));
    let frames = format!("{} labelled frames of {}", results.input.labelled, results.setup.source);
    let objects = format!("objects that count: {}", objects.join(", "));
    [vec![frames, objects], devices].concat().join(" · ")
}

/// The conditions as part of a file's name.
fn suffix((psf_sigma, noise): Conditions) -> String {
    format!("psf{psf_sigma}_noise{noise}")
}

/// A name as part of a file's name.
fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' }).collect()
}
