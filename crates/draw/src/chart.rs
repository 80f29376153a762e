//! [`Chart`]: title, subtitle, panels, legend and footer.

use std::collections::HashSet;

use crate::canvas::{Anchor, Canvas};
use crate::font::Font;
use crate::panel;
use crate::panel::{ChartPanel, Series, SeriesStyle};
use crate::primitives::{FADED_TEXT, GREY, INK, Position};
use crate::style::Style;

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The title. It is wrapped if the page is narrow.
    pub title: String,
    /// The data and the machine. It is wrapped.
    pub subtitle: String,
    /// How to read the chart. It is wrapped.
    pub footer: String,
    /// The panels, side by side if there is room, else below each other, with a common legend.
    pub panels: Vec<ChartPanel>,
}

/// Width of the page of a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageWidth {
    /// 1200 px, for a screen or a sheet of paper.
    Wide = 1200,
    /// 420 px, for a phone.
    Narrow = 420,
}

const MARGIN: f32 = 24.0;

impl Chart {
    /// The chart as SVG 1.1.
    pub fn svg(&self, page: PageWidth) -> String {
        let mut canvas = Canvas::new(f32::from(page as u16), Font::new());
        let mut y = canvas.paragraph((MARGIN, MARGIN + 18.0), &self.title, 20.0, INK);
        y = canvas.paragraph((MARGIN, y - 7.0), &self.subtitle, 12.5, GREY);
        let width = canvas.width - MARGIN;
        y = panel::draw_all(&mut canvas, &self.panels, (MARGIN, y, width));
        y = draw_legend(&mut canvas, &self.legend(), (MARGIN, y + 16.0));
        y = canvas.paragraph((MARGIN, y + 8.0), &self.footer, 11.0, GREY);
        // The height is known only now, since the wrapped texts depend on the width of the page.
        canvas.height = (y + MARGIN / 2.0).ceil();
        canvas.document(&self.title)
    }

    /// The entries of the legend in the order of first appearance. A series that is in several panels has one.
    fn legend<'a>(&'a self) -> Vec<LegendEntry<'a>> {
        let all = || self.panels.iter().flat_map(|panel| &panel.series);
        let entry = |first: &'a Series| {
            // The key of a series is as grey as its points.
            let own = all().filter(|series| series.name == first.name);
            let mut points = own.flat_map(|series| &series.points).peekable();
            let is_faded = points.peek().is_some() && points.all(|point| point.is_faded);
            LegendEntry { name: &first.name, drawn: first.style, is_faded }
        };
        let mut entries: Vec<LegendEntry<'a>> = all().map(entry).collect();
        let mut names = HashSet::new();
        entries.retain(|entry| names.insert(entry.name));
        entries
    }
}

/// A name with the symbol beside it.
struct LegendEntry<'a> {
    name: &'a str,
    drawn: SeriesStyle,
    is_faded: bool,
}

const LEGEND_SIZE: f32 = 12.5;
const LEGEND_LINE: f32 = 20.0;
/// Width of a key, px.
const KEY_WIDTH: f32 = 34.0;

impl LegendEntry<'_> {
    fn draw_key(&self, canvas: &mut Canvas, (x, y): Position) {
        let style = Style::of(self.name);
        if self.drawn != SeriesStyle::Markers {
            style.line(canvas, &[(x, y), (x + KEY_WIDTH, y)]);
        }
        if self.drawn != SeriesStyle::Line {
            style.mark(canvas, (x + KEY_WIDTH / 2.0, y), self.is_faded, "");
        }
    }
}

/// Draws the legend: the names with their keys in columns. Returns the y below them.
fn draw_legend(canvas: &mut Canvas, entries: &[LegendEntry<'_>], (left, top): Position) -> f32 {
    if entries.is_empty() {
        return top;
    }
    let widest = entries.iter().map(|entry| canvas.font.width(entry.name, LEGEND_SIZE)).fold(0.0, f32::max);
    let column = widest + KEY_WIDTH + 36.0;
    let columns = (((canvas.width - 2.0 * left) / column) as usize).clamp(1, entries.len().max(1));
    for (index, entry) in entries.iter().enumerate() {
        let x = left + column * (index % columns) as f32;
        let y = top + LEGEND_LINE * (index / columns) as f32;
        entry.draw_key(canvas, (x, y));
        let spot = (x + KEY_WIDTH + 8.0, y + LEGEND_SIZE * 0.36);
        let colour = if entry.is_faded { FADED_TEXT } else { INK };
        canvas.text(spot, entry.name, LEGEND_SIZE, colour, Anchor::Start);
    }
    top + LEGEND_LINE * entries.len().div_ceil(columns) as f32
}
