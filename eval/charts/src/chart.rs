//! [`Chart`]: a title, what it is about, the body, the legend, how to read it.

use crate::bars::Bars;
use crate::canvas::{Canvas, GREY, INK};
use crate::legend::Swatch;
use crate::pictures::Pictures;
use crate::series::Panel;
use crate::{ChartError, font, legend, panel, raster, svg};

/// Something to look at.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// One line, wrapped where the page is narrow.
    pub title: String,
    /// What was measured on what; wrapped where it is long.
    pub subtitle: String,
    /// How to read it; wrapped where it is long.
    pub footer: String,
    /// What is drawn.
    pub body: Body,
}

/// What a chart is made of.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// From left to right where there is room, else one below the other; their series have a common legend.
    Panels(Vec<Panel>),
    /// Lengths beside each other.
    Bars(Bars),
    /// A table of pictures.
    Pictures(Pictures),
}

/// How wide a chart may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Page {
    /// 1200 px: a desk, a sheet of paper.
    Wide,
    /// 560 px: a phone.
    Narrow,
}

const MARGIN: f32 = 24.0;

impl Page {
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
    /// [`ChartError::Font`]; [`ChartError::Encode`] of a picture.
    pub fn svg(&self, page: Page) -> Result<String, ChartError> {
        svg::text(&self.canvas(page)?)
    }

    /// [`Page::Wide`] as PNG, twice the pixels of the SVG along each side.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn png(&self) -> Result<Vec<u8>, ChartError> {
        raster::png(&self.canvas(Page::Wide)?)
    }

    fn canvas(&self, page: Page) -> Result<Canvas, ChartError> {
        let mut canvas = Canvas::new(page.width(), font::Font::new()?);
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
        Ok(canvas)
    }
}

impl Body {
    /// What the legend explains, in the order of first appearance.
    fn names(&self) -> Vec<(&str, Swatch)> {
        let all: Vec<(&str, Swatch)> = match self {
            Self::Panels(panels) => {
                let series = panels.iter().flat_map(|panel| &panel.series);
                series.map(|s| (s.name.as_str(), Swatch::Series(s.look))).collect()
            }
            Self::Bars(bars) => bars.parts().map(|name| (name, Swatch::Block)).collect(),
            Self::Pictures(_) => Vec::new(),
        };
        let mut names: Vec<(&str, Swatch)> = Vec::new();
        for named in all {
            if names.iter().all(|(name, _)| *name != named.0) {
                names.push(named);
            }
        }
        names
    }
}
