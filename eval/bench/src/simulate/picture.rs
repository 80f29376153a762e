//! Sends one image through the sensor and the methods, and writes the results.

use std::path::{Path, PathBuf};

use modulo_core::metric::{exact_share, mse, psnr_db, ssim};
use modulo_core::{Exposure, Recovered, Sensor, Unwrap, tone};
use modulo_images::{White, read_image, save_png};
use ndarray::Array3;

use super::{Request, Row};
use crate::stopwatch::timed;
use crate::{BenchError, samples8};

/// An image of the request.
pub struct Picture<'a> {
    pub file: &'a Path,
    pub name: &'a str,
    pub request: &'a Request,
}

impl Picture<'_> {
    /// Reads radiance in `[0, 1)`, H x W x C.
    pub fn read(&self) -> Result<Array3<f32>, BenchError> {
        Ok(White::new(self.request.white)?.radiance(&read_image(self.file)?))
    }

    /// Writes all streams at one alpha, and returns a row for each method.
    pub fn sense(
        &self,
        radiance: &Array3<f32>,
        sensor: &Sensor,
        methods: &mut [Box<dyn Unwrap>],
    ) -> Result<Vec<Row>, BenchError> {
        let exposure = sensor.expose(radiance.view(), self.request.sensor.seed)?;
        let path = |stream: &str| self.path(exposure.range().alpha(), stream);
        save_png(&path("ideal"), &exposure.ideal())?;
        save_png(&path("saturated"), &exposure.saturated())?;
        save_png(&path("modulo"), &exposure.modulo())?;
        methods.iter_mut().map(|method| self.recover(&exposure, method.as_mut())).collect()
    }

    fn recover(&self, exposure: &Exposure, method: &mut dyn Unwrap) -> Result<Row, BenchError> {
        let (range, modulo) = (exposure.range(), exposure.modulo());
        let mut recovered = Recovered::default();
        let (unwrapped, ms) = timed(|| method.unwrap(&modulo, range, &mut recovered));
        unwrapped?;
        let picture = tone::linear8(&recovered.x, range).map_err(modulo_core::UnwrapError::from)?;
        save_png(&self.path(range.alpha(), method.name()), &picture)?;
        let (ideal, picture) = (samples8(exposure.ideal()), samples8(picture));
        Ok(Row {
            file: self.file.display().to_string(),
            alpha: range.alpha(),
            psf_sigma: self.request.sensor.psf().sigma(),
            method: method.name().to_owned(),
            psnr_db: psnr_db(mse(&picture, &ideal)?),
            ssim: ssim(&picture, &ideal)?,
            exact_k: exact_share(&recovered.k, &exposure.wraps())?,
            rung: recovered.report.rung.to_owned(),
            trusted: recovered.report.trust.claim(),
            ms,
        })
    }

    fn path(&self, alpha: f64, stream: &str) -> PathBuf {
        self.request.out.join(format!("{}_alpha{alpha}_{stream}.png", self.name))
    }
}
