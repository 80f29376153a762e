//! One picture through the sensor and the methods, results to the folder.

use std::path::{Path, PathBuf};

use modulo_core::{Exposure, Recovered, Sensor, Unwrap, tone};
use modulo_images::{White, read_image, save_png};
use ndarray::Array3;

use super::{Request, Row};
use crate::stopwatch::timed;
use crate::{StudyError, shown};
use modulo_core::metric::{exact_share, mse, psnr_db, ssim};

/// A picture of the request.
pub struct Picture<'a> {
    pub file: &'a Path,
    pub name: &'a str,
    pub request: &'a Request,
}

impl Picture<'_> {
    /// Radiance in `[0, 1)`, H x W x C.
    pub fn read(&self) -> Result<Array3<f32>, StudyError> {
        Ok(White::new(self.request.white)?.radiance(&read_image(self.file)?))
    }

    /// All streams at one alpha, and a row for each method.
    pub fn sense(
        &self,
        radiance: &Array3<f32>,
        sensor: &Sensor,
        methods: &mut [Box<dyn Unwrap>],
    ) -> Result<Vec<Row>, StudyError> {
        let exposure = sensor.expose(radiance.view(), self.request.seed)?;
        let place = |stream: &str| self.place(exposure.range().alpha(), stream);
        save_png(&place("ideal"), &exposure.ideal())?;
        save_png(&place("saturated"), &exposure.saturated())?;
        save_png(&place("modulo"), &exposure.modulo())?;
        methods.iter_mut().map(|method| self.recover(&exposure, method.as_mut())).collect()
    }

    fn recover(&self, exposure: &Exposure, method: &mut dyn Unwrap) -> Result<Row, StudyError> {
        let (range, modulo) = (exposure.range(), exposure.modulo());
        let mut recovered = Recovered::default();
        let (unwrapped, ms) = timed(|| method.unwrap(&modulo, range, &mut recovered));
        unwrapped?;
        let picture = tone::linear8(&recovered.x, range).map_err(modulo_core::UnwrapError::from)?;
        save_png(&self.place(range.alpha(), method.name()), &picture)?;
        let (ideal, picture) = (shown(exposure.ideal()), shown(picture));
        Ok(Row {
            file: self.file.display().to_string(),
            alpha: range.alpha(),
            psf_sigma: self.request.psf.sigma(),
            method: method.name().to_owned(),
            psnr_db: psnr_db(mse(&picture, &ideal)?),
            ssim: ssim(&picture, &ideal)?,
            exact_k: exact_share(&recovered.k, &exposure.wraps())?,
            rung: recovered.report.rung.to_owned(),
            trusted: recovered.report.trust.claim(),
            ms,
        })
    }

    fn place(&self, alpha: f64, stream: &str) -> PathBuf {
        self.request.out.join(format!("{}_alpha{alpha}_{stream}.png", self.name))
    }
}
