//! [`Chart`]: title, subtitle, body, legend and footer; and [`Pictures`], a kind of body.

use crate::axis::distinct;
use crate::canvas::{Anchor, Canvas, Shape};
use crate::font::Font;
use crate::panel::{ChartPanel, SeriesStyle};
use crate::picture::Picture;
use crate::primitives::{Colour, FADED_TEXT, GREY, INK, Position};
use crate::style::Style;
use crate::{ChartError, panel, raster, svg};

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The title. It is wrapped if the page is narrow.
    pub title: String,
    /// The data and the machine. It is wrapped.
    pub subtitle: String,
    /// How to read the chart. It is wrapped.
    pub footer: String,
    /// The content.
    pub body: ChartBody,
}

/// The content of a chart.
#[derive(Clone, Debug, PartialEq)]
pub enum ChartBody {
    /// Panels, side by side if there is room, else below each other, with a common legend.
    Panels(Vec<ChartPanel>),
    /// A table of images.
    Pictures(Pictures),
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
    ///
    /// # Errors
    /// [`ChartError::Encode`] of an image.
    pub fn svg(&self, page: PageWidth) -> Result<String, ChartError> {
        svg::text(&self.canvas(page))
    }

    /// The chart of [`PageWidth::Wide`] as PNG, with twice the pixels of the SVG along each side.
    ///
    /// # Errors
    /// [`ChartError::Size`] or [`ChartError::Encode`].
    pub fn png(&self) -> Result<Vec<u8>, ChartError> {
        raster::png(&self.canvas(PageWidth::Wide))
    }

    fn canvas(&self, page: PageWidth) -> Canvas {
        let mut canvas = Canvas::new(f32::from(page as u16), Font::new());
        let mut y = canvas.paragraph((MARGIN, MARGIN + 18.0), &self.title, 20.0, INK);
        y = canvas.paragraph((MARGIN, y - 7.0), &self.subtitle, 12.5, GREY);
        let names = self.body.names();
        let width = canvas.width - MARGIN;
        y = match &self.body {
            ChartBody::Panels(panels) => panel::draw_all(&mut canvas, panels, (MARGIN, y, width)),
            ChartBody::Pictures(pictures) => pictures.draw(&mut canvas, (MARGIN, y, width)),
        };
        y = draw_legend(&mut canvas, &names, (MARGIN, y + 16.0));
        y = canvas.paragraph((MARGIN, y + 8.0), &self.footer, 11.0, GREY);
        // The height is known only now, since the wrapped texts depend on the width of the page.
        canvas.height = (y + MARGIN / 2.0).ceil();
        canvas
    }
}

impl ChartBody {
    /// The entries of the legend in the order of first appearance.
    fn names(&self) -> Vec<(&str, LegendKey)> {
        let all: Vec<(&str, LegendKey)> = match self {
            Self::Panels(panels) => {
                let series = || panels.iter().flat_map(|panel| &panel.series);
                // The key of a series is as grey as its points.
                let is_faded = |name: &str| {
                    let own = series().filter(|other| other.name == name);
                    let mut points = own.flat_map(|other| &other.points).peekable();
                    points.peek().is_some() && points.all(|point| point.is_faded)
                };
                series().map(|s| (s.name.as_str(), LegendKey::Series(s.style, is_faded(&s.name)))).collect()
            }
            Self::Pictures(pictures) => {
                let boxes = pictures.legend.iter();
                boxes.map(|(name, colour)| (name.as_str(), LegendKey::Colour(*colour))).collect()
            }
        };
        // A series that is in several panels has one entry.
        let first = |name| all.iter().find(|entry| entry.0 == name).copied();
        distinct(all.iter().map(|entry| entry.0)).into_iter().filter_map(first).collect()
    }
}

const LEGEND_SIZE: f32 = 12.5;
const LEGEND_LINE: f32 = 20.0;
/// Width of a key, px.
const KEY_WIDTH: f32 = 34.0;
/// Half a side of a filled area, px.
const KEY_BLOCK: f32 = 6.5;

/// The symbol beside a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegendKey {
    /// The style of a series, and whether all its points are grey.
    Series(SeriesStyle, bool),
    /// A filled square of this colour.
    Colour(Colour),
}

impl LegendKey {
    fn draw(self, canvas: &mut Canvas, style: &Style, (x, y): Position) {
        if let Self::Series(SeriesStyle::LineAndMarkers | SeriesStyle::Line, _) = self {
            style.line(canvas, vec![(x, y), (x + KEY_WIDTH, y)]);
        }
        if let Self::Series(SeriesStyle::LineAndMarkers | SeriesStyle::Markers, is_faded) = self {
            style.mark(canvas, (x + KEY_WIDTH / 2.0, y), is_faded, "");
        }
        let Self::Colour(colour) = self else { return };
        let area =
            (x + KEY_WIDTH / 2.0 - KEY_BLOCK, y - KEY_BLOCK, x + KEY_WIDTH / 2.0 + KEY_BLOCK, y + KEY_BLOCK);
        canvas.block(area, colour);
    }
}

/// Draws the legend: the names with their keys in columns. Returns the y below them.
fn draw_legend(canvas: &mut Canvas, names: &[(&str, LegendKey)], (left, top): Position) -> f32 {
    if names.is_empty() {
        return top;
    }
    let widest = names.iter().map(|(name, _)| canvas.font.width(name, LEGEND_SIZE)).fold(0.0, f32::max);
    let column = widest + KEY_WIDTH + 36.0;
    let columns = (((canvas.width - 2.0 * left) / column) as usize).clamp(1, names.len().max(1));
    for (index, (name, key)) in names.iter().enumerate() {
        let x = left + column * (index % columns) as f32;
        let y = top + LEGEND_LINE * (index / columns) as f32;
        key.draw(canvas, &Style::of(name), (x, y));
        let spot = (x + KEY_WIDTH + 8.0, y + LEGEND_SIZE * 0.36);
        let colour = if matches!(key, LegendKey::Series(_, true)) { FADED_TEXT } else { INK };
        canvas.text(spot, name, LEGEND_SIZE, colour, Anchor::Start);
    }
    top + LEGEND_LINE * names.len().div_ceil(columns) as f32
}

/// A table of images.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Name of each row and its image in each column. `None` leaves the place empty.
    pub rows: Vec<(String, Vec<Option<Picture>>)>,
    /// Names and colours of the boxes.
    pub legend: Vec<(String, [u8; 3])>,
}

/// Font size of the names, px.
const NAME_SIZE: f32 = 12.5;
/// Distance between two images, px.
const PICTURE_GAP: f32 = 6.0;
/// Pages of at least this width have two images side by side.
const WIDE: f32 = 900.0;

impl Pictures {
    /// Draws into (left, top, width), each image below the name of its column. Returns the y below it.
    pub(crate) fn draw(&self, canvas: &mut Canvas, (left, top, width): (f32, f32, f32)) -> f32 {
        let columns: u8 = if canvas.width < WIDE { 1 } else { 2 };
        let cell = (width - left + PICTURE_GAP) / f32::from(columns) - PICTURE_GAP;
        let height = |picture: &Picture| cell / picture.size().0 as f32 * picture.size().1 as f32;
        let mut y = top;
        for (name, pictures) in &self.rows {
            canvas.text((left, y + NAME_SIZE), name, NAME_SIZE, INK, Anchor::Start);
            y += 1.5 * NAME_SIZE;
            let named: Vec<_> = self.columns.iter().zip(pictures).collect();
            for line in named.chunks(columns.into()) {
                y += 1.5 * NAME_SIZE;
                for (column, (name, picture)) in (0u8..).zip(line) {
                    let Some(picture) = picture else { continue };
                    let x = left + f32::from(column) * (cell + PICTURE_GAP);
                    canvas.text((x, y - 0.4 * NAME_SIZE), name, NAME_SIZE, GREY, Anchor::Start);
                    let area = (x, y, x + cell, y + height(picture));
                    canvas.shapes.push(Shape::Picture { area, picture: picture.clone() });
                }
                y += line.iter().filter_map(|(_, picture)| picture.as_ref()).map(height).fold(0.0, f32::max);
            }
            y += NAME_SIZE;
        }
        y
    }
}
