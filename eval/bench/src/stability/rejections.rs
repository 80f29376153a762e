//! Inputs that must be refused.

use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{Frame, Psf, Range, Recovered, Sensor, SensorConfig};
use ndarray::Array3;

use super::report::RejectionRow;

const SENSOR: SensorConfig = SensorConfig { psf: Psf::Paper7, ..SensorConfig::PLAIN };

/// Tries the inputs that must be refused with an error that names the place and the value.
pub fn rejections() -> Vec<RejectionRow> {
    let mut rows: Vec<_> = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().map(radiance).collect();
    rows.extend([(0, 4, 3), (4, 0, 3), (4, 4, 2)].map(shape));
    let wrong = |name: &str, value: f64, config| {
        row(format!("{name} = {value} for the sensor"), Sensor::new(config), value)
    };
    rows.extend([0, 17].map(|bits| wrong("bits", f64::from(bits), SensorConfig { bits, ..SENSOR })));
    rows.extend([0.0, f64::NAN, 257.0].map(|alpha| wrong("alpha", alpha, SensorConfig { alpha, ..SENSOR })));
    rows.extend(METHODS.iter().map(|method| code(method)));
    rows
}

/// An image with one invalid pixel.
fn radiance(value: f32) -> RejectionRow {
    let mut image = Array3::from_elem((6, 8, 3), 0.25);
    image[(2, 5, 1)] = value;
    let result = Sensor::new(SENSOR).and_then(|sensor| sensor.expose(image.view(), 0));
    row(format!("one pixel of radiance {value} for the sensor"), result, "row 2, column 5, channel 1")
}

fn shape(dim: (usize, usize, usize)) -> RejectionRow {
    let (height, width, channels) = dim;
    let result = Sensor::new(SENSOR).and_then(|sensor| sensor.expose(Array3::zeros(dim).view(), 0));
    let wrong = if channels == 2 { channels } else { 0 };
    row(format!("an image of {height} x {width} x {channels} for the sensor"), result, wrong)
}

/// A code of 9 bits in an image of 8 bits.
fn code(method: &str) -> RejectionRow {
    let mut codes = Array3::from_elem((6, 8, 3), 7u16);
    // An image of 16 bits can hold a code that a sensor of 8 bits never delivers. A method that took it would compute
    // with a modulo value above the peak.
    codes[(2, 5, 1)] = 256;
    let unwrap = || {
        let range = Range::new(8, 4.0).map_err(|e| e.to_string())?;
        let y = Frame::from_u16(codes).map_err(|e| e.to_string())?;
        let mut method = by_name(method, &Options::default()).map_err(|e| e.to_string())?;
        method.unwrap(&y, range, &mut Recovered::default()).map_err(|e| e.to_string())
    };
    row(format!("a code of 256 with 8 bits for {method}"), unwrap(), "row 2, column 5, channel 1) is 256")
}

/// The row of an input. It holds if the error contains `named`.
fn row<T, E: ToString>(what: String, result: Result<T, E>, named: impl ToString) -> RejectionRow {
    match result {
        Ok(_) => RejectionRow { what, message: "nothing: it was taken".to_owned(), held: false },
        Err(error) => {
            let message = error.to_string();
            RejectionRow { held: message.contains(&named.to_string()), what, message }
        }
    }
}
