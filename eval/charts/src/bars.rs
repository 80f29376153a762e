use crate::axis::{Axis, Scale};
use crate::canvas::{Anchor, Canvas};
use crate::number;
use crate::primitives::{FAINT, GREY, INK, Style};

/// Horizontal bars of several parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Bars {
    /// Quantity and unit of the lengths.
    pub label: String,
    /// The bars from top to bottom.
    pub rows: Vec<Bar>,
}

/// One bar.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// Label at the left.
    pub label: String,
    /// Name and length, 0 or more, in the unit of the axis; a part has the colour of its name.
    pub parts: Vec<(String, f64)>,
    /// Text after the bar.
    pub note: String,
}

const SIZE: f32 = 12.0;
const ROW: f32 = 24.0;
const BELOW: f32 = 46.0;
/// Labels that need a larger share of the width are above their bar.
const LABELS: f32 = 0.35;

impl Bars {
    /// Names of all parts, with repetitions.
    pub(crate) fn parts(&self) -> impl Iterator<Item = &str> {
        self.rows.iter().flat_map(|row| &row.parts).map(|(name, _)| name.as_str())
    }

    /// Draws into (left, top, width). Returns the y below it.
    pub(crate) fn draw(&self, canvas: &mut Canvas, (left, top, width): (f32, f32, f32)) -> f32 {
        let width_of = |text: &str| canvas.font.width(text, SIZE);
        let widest = self.rows.iter().map(|row| width_of(&row.label)).fold(0.0, f32::max);
        let labels = self.rows.iter().map(|row| width_of(&row.note)).fold(0.0, f32::max);
        // On a narrow page, labels beside the bars would leave no width for the bars.
        let above = widest > LABELS * width;
        let (from, line) = if above { (left, 2.0 * ROW) } else { (left + widest + 10.0, ROW) };
        let (to, bottom) = (left + width - labels - 44.0, top + line * self.rows.len() as f32 + 6.0);
        let place = self.axis(canvas, (from, top, to, bottom));
        for (index, row) in self.rows.iter().enumerate() {
            let y = top + line * index as f32 + if above { ROW } else { 0.0 };
            let label = if above { (left, y, Anchor::Start) } else { (from - 8.0, y + 16.0, Anchor::End) };
            canvas.text((label.0, label.1), &row.label, SIZE, INK, label.2);
            let mut start = 0.0;
            for (name, length) in row.parts.iter().filter(|(_, length)| length.is_finite()) {
                let area = (place(start), y + 4.0, place(start + length), y + ROW - 4.0);
                let hover = format!("{}, {name}: {}", row.label, number(*length, 3));
                canvas.block(area, Style::of(name).colour, &hover);
                start += length;
            }
            canvas.text((place(start) + 6.0, y + 16.0), &row.note, SIZE, GREY, Anchor::Start);
        }
        bottom + BELOW
    }

    /// Draws the grid. Returns the function from a length to its x.
    fn axis(
        &self,
        canvas: &mut Canvas,
        (left, top, right, bottom): (f32, f32, f32, f32),
    ) -> impl Fn(f64) -> f32 + use<> {
        let total = |row: &Bar| row.parts.iter().map(|(_, length)| length).sum::<f64>();
        let totals = self.rows.iter().map(total).filter(|total| total.is_finite());
        // Not 0, by which the lengths are divided.
        let most = totals.fold(f64::MIN_POSITIVE, f64::max);
        let axis = Axis { scale: Scale::Linear { from: 0.0, to: most }, ..Axis::log("") };
        let place = move |value: f64| left + (value / most) as f32 * (right - left);
        for (value, text) in axis.fit(std::iter::empty()).ticks {
            canvas.line(vec![(place(value), top), (place(value), bottom)], FAINT, 1.0);
            canvas.text((place(value), bottom + 17.0), &text, SIZE - 0.5, GREY, Anchor::Middle);
        }
        canvas.line(vec![(left, top), (left, bottom)], GREY, 1.2);
        canvas.text(((left + right) / 2.0, bottom + 38.0), &self.label, 12.5, INK, Anchor::Middle);
        place
    }
}
