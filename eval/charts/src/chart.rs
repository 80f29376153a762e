//! [`Chart`]: title, subtitle, body, legend and footer.

use crate::bars::Bars;
use crate::canvas::Canvas;
use crate::legend::LegendKey;
use crate::pictures::Pictures;
use crate::primitives::{GREY, INK};
use crate::series::Panel;
use crate::{ChartError, font, legend, panel, raster, svg};

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
    pub body: Body,
}

/// The content of a chart.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// Panels, side by side if there is room, else below each other, with a common legend.
    Panels(Vec<Panel>),
    /// Bars.
    Bars(Bars),
    /// A table of images.
    Pictures(Pictures),
}

/// Width of the page of a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageWidth {
    /// 1200 px, for a screen or a sheet of paper.
    Wide,
    /// 560 px, for a phone.
    Narrow,
}

const MARGIN: f32 = 24.0;

impl PageWidth {
    fn width(self) -> f32 {
        match self {
            Self::Wide => 1200.0,
            Self::Narrow => 560.0,
        }
    }
}

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
        let mut canvas = Canvas::new(page.width(), font::Font::new());
        let mut y = canvas.paragraph((MARGIN, MARGIN + 18.0), &self.title, 20.0, INK);
        y = canvas.paragraph((MARGIN, y - 7.0), &self.subtitle, 12.5, GREY);
        let names = self.body.names();
        let width = canvas.width - MARGIN;
        y = match &self.body {
            Body::Panels(panels) => panel::draw_all(&mut canvas, panels, &names, (MARGIN, y, width)),
            Body::Bars(bars) => bars.draw(&mut canvas, &names, (MARGIN, y, width)),
            Body::Pictures(pictures) => pictures.draw(&mut canvas, (MARGIN, y, width)),
        };
        y = legend::draw(&mut canvas, &names, (MARGIN, y + 16.0));
        y = canvas.paragraph((MARGIN, y + 8.0), &self.footer, 11.0, GREY);
        canvas.height = (y + MARGIN / 2.0).ceil();
        canvas
    }
}

/// The distinct values in the order of their first appearance.
pub fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

impl Body {
    /// The entries of the legend in the order of first appearance.
    fn names(&self) -> Vec<(&str, LegendKey)> {
        let all: Vec<(&str, LegendKey)> = match self {
            Self::Panels(panels) => {
                let series = panels.iter().flat_map(|panel| &panel.series);
                series.map(|s| (s.name.as_str(), LegendKey::Series(s.style))).collect()
            }
            Self::Bars(bars) => bars.parts().map(|name| (name, LegendKey::Block)).collect(),
            Self::Pictures(pictures) => {
                let boxes = pictures.legend.iter();
                boxes.map(|(name, colour)| (name.as_str(), LegendKey::Colour(*colour))).collect()
            }
        };
        let first = |name| all.iter().find(|entry| entry.0 == name).copied();
        distinct(all.iter().map(|entry| entry.0)).into_iter().filter_map(first).collect()
    }
}
