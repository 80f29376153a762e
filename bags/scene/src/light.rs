//! The light and colour of each preset, in linear radiance with 1.0 = top of the represented range.
//!
//! With these values, a camera that clips at a quarter of the range records day and night well, and loses the
//! objects in glare or in the exit of the tunnel.

use super::Preset;
use super::hash::ramp;
use super::view::{CameraView, Point};

/// Linear red, green and blue.
pub(super) type Rgb = [f32; 3];

pub(super) fn add(a: Rgb, b: Rgb) -> Rgb {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn scaled(a: Rgb, s: f32) -> Rgb {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Interpolates from `a` at `t = 0` to `b` at `t = 1` per channel.
pub(super) fn blend(a: Rgb, b: Rgb, t: f32) -> Rgb {
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t]
}

/// The light on a surface.
#[derive(Clone, Copy, Debug)]
struct Sky {
    ambient: Rgb,
    sun: Rgb,
    /// The unit vector towards the sun.
    towards: Point,
    /// The radiance of the air far away.
    haze: Rgb,
    /// The distance in m at which half of the radiance is haze.
    haze_at: f32,
}

/// The light of one frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    preset: Preset,
    outside: Sky,
    /// The camera car's own head lamps, irradiance at the bumper.
    own_lamps: f32,
    /// The distance of the tunnel's exit in m; beyond it the light is `outside`.
    exit: f32,
    /// The centre of the glare in px.
    pub(super) glare: [f32; 2],
    /// The radius in px at which the glare has half its height.
    spread: [f32; 2],
    /// The height of the glare.
    veil: Rgb,
}

const DAY: Sky = Sky {
    ambient: [0.082, 0.092, 0.108],
    sun: [0.185, 0.172, 0.148],
    towards: [-0.45, 0.70, -0.55],
    haze: [0.24, 0.27, 0.31],
    haze_at: 260.0,
};
const LOW_SUN: Sky = Sky {
    ambient: [0.150, 0.135, 0.120],
    sun: [0.240, 0.200, 0.150],
    towards: [0.10, 0.45, 0.88],
    haze: [0.46, 0.41, 0.33],
    haze_at: 85.0,
};
const EXIT: Sky = Sky {
    ambient: [0.200, 0.210, 0.220],
    sun: [0.120, 0.115, 0.100],
    towards: [-0.30, 0.93, 0.20],
    haze: [0.46, 0.48, 0.50],
    haze_at: 110.0,
};
const NIGHT: Sky = Sky {
    ambient: [0.052, 0.050, 0.054],
    sun: [0.030, 0.026, 0.018],
    towards: [0.00, 0.90, -0.43],
    haze: [0.012, 0.013, 0.018],
    haze_at: 160.0,
};

/// What faces the camera has the light of the blue sky behind it.
const SUNSET: Sky = Sky {
    ambient: [0.085, 0.090, 0.115],
    sun: [0.260, 0.140, 0.055],
    towards: [0.05, 0.24, 0.97],
    haze: [0.215, 0.112, 0.058],
    haze_at: 150.0,
};

impl Light {
    /// Makes the light of a preset. `exit` is the distance of the tunnel's exit in m, which only
    /// [`Preset::Tunnel`] uses; `sun` is the position of the sun in px.
    pub(super) fn new(preset: Preset, exit: f32, sun: [f32; 2], view: &CameraView) -> Self {
        let s = view.scale();
        let (outside, own_lamps, spread, veil) = match preset {
            Preset::Day => (DAY, 0.0, [60.0 * s; 2], [0.0; 3]),
            Preset::Glare => (LOW_SUN, 0.0, [185.0 * s, 120.0 * s], [0.40, 0.36, 0.29]),
            Preset::Tunnel => {
                let size = view.focal / exit;
                (EXIT, 0.22, [size * 7.5, size * 5.0], [0.36, 0.37, 0.37])
            }
            Preset::Night => (NIGHT, 0.26, [60.0 * s; 2], [0.0; 3]),
            Preset::Sunset => (SUNSET, 0.03, [150.0 * s, 100.0 * s], [0.030, 0.019, 0.010]),
        };
        let glare = if preset == Preset::Tunnel { view.project([-0.7, 2.2, exit]) } else { sun };
        // With its exit at the camera, every place counts as outside of the tunnel.
        let exit = if preset == Preset::Tunnel { exit } else { 0.0 };
        Self { preset, outside, own_lamps, exit, glare, spread, veil }
    }

    /// Returns whether vehicles drive with their lamps on, as in the tunnel, at night and at sunset.
    pub(super) fn lamps(&self) -> bool {
        self.own_lamps > 0.0
    }

    /// Returns the radiance of a surface of reflectance `albedo` with unit `normal`, `z` m ahead.
    pub(super) fn shade(&self, albedo: Rgb, normal: Point, z: f32) -> Rgb {
        let sky = &self.outside;
        let lit = normal.iter().zip(sky.towards).map(|(n, l)| n * l).sum::<f32>().max(0.0);
        // Even surfaces that face away get some light, by the reflection of the surroundings.
        let facing = (-normal[2]).max(0.25);
        let own = self.own_lamps * facing / (1.0 + z * z / 700.0);
        let outside = add(scaled(sky.sun, lit), sky.ambient);
        let open = add(self.indoors(outside, z), [own, own * 0.97, own * 0.88]);
        let seen = [albedo[0] * open[0], albedo[1] * open[1], albedo[2] * open[2]];
        // Haze begins at the exit, since the air in the tunnel is clear.
        let air = (z - self.exit).max(0.0);
        blend(seen, sky.haze, air / (air + sky.haze_at))
    }

    /// Returns the irradiance inside the tunnel: dim, brighter towards the exit.
    fn indoors(&self, outside: Rgb, z: f32) -> Rgb {
        if z >= self.exit {
            return outside;
        }
        let depth = (self.exit - z) / 7.0;
        blend([0.046, 0.040, 0.030], outside, 1.0 / (1.0 + depth * depth))
    }

    /// Returns the stray light of lens and air at pixel (`u`, `v`): A / (1 + r^2).
    pub(super) fn veil(&self, u: f32, v: f32) -> Rgb {
        // By day and at night there is no glare, and each pixel saves a division.
        if self.veil[0] == 0.0 {
            return [0.0; 3];
        }
        let (x, y) = ((u - self.glare[0]) / self.spread[0], (v - self.glare[1]) / self.spread[1]);
        let fall = 1.0 / (1.0 + x * x + y * y);
        scaled(self.veil, fall)
    }

    /// Returns the radiance of the open sky without clouds.
    pub(super) fn sky(&self, u: f32, v: f32, view: &CameraView) -> Rgb {
        let up = ((view.cy - v) / view.focal).max(0.0);
        // The colour changes within the first 24 degrees above the horizon.
        let t = ramp(0.0, 0.45, up);
        match self.preset {
            Preset::Day => blend([0.29, 0.32, 0.36], [0.13, 0.20, 0.33], t),
            Preset::Glare => self.sunny(u, v, view, t),
            Preset::Tunnel => blend([0.44, 0.45, 0.46], [0.39, 0.42, 0.46], t),
            Preset::Night => blend([0.020, 0.020, 0.026], [0.006, 0.008, 0.016], t),
            Preset::Sunset => self.dusk(u, v, view, t),
        }
    }

    fn sunny(&self, u: f32, v: f32, view: &CameraView, t: f32) -> Rgb {
        let base = blend([0.38, 0.33, 0.25], [0.24, 0.26, 0.31], t);
        let s = view.scale();
        let (x, y) = ((u - self.glare[0]) / s, (v - self.glare[1]) / s);
        let r2 = x * x + y * y;
        let aura = 0.30 / (1.0 + r2 / 1500.0);
        let disc = 1.0 - ramp(3.0, 15.0, r2.sqrt());
        add(base, [aura + 0.35 * disc, aura * 0.86 + 0.40 * disc, aura * 0.60 + 0.50 * disc])
    }

    /// Returns the sky around the setting sun: blue above, red along the horizon, and an aura of which each step of brightness is a ring.
    fn dusk(&self, u: f32, v: f32, view: &CameraView, t: f32) -> Rgb {
        let base = blend([0.190, 0.088, 0.046], [0.026, 0.043, 0.095], ramp(0.0, 1.0, 1.9 * t));
        let s = view.scale();
        // The aura is wider than it is high, since the haze is low.
        let (x, y) = ((u - self.glare[0]) / s / 1.5, (v - self.glare[1]) / s);
        let r2 = x * x + y * y;
        let aura = 0.50 / (1.0 + r2 / 5200.0) + 0.30 / (1.0 + r2 / 420.0);
        let disc = 0.45 * (1.0 - ramp(5.0, 11.0, r2.sqrt()));
        add(base, [aura + disc, aura * 0.60 + disc * 0.9, aura * 0.27 + disc * 0.7])
    }

    /// Compresses everything above 0.85 smoothly below 1.0.
    pub(super) fn shoulder(radiance: f32) -> f32 {
        // A hyperbola with slope 1 at its start and 1 as its limit: smooth, without an exponential.
        let over = radiance - 0.85;
        if over <= 0.0 { radiance.max(0.0) } else { 0.85 + 0.15 * over / (over + 0.15) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shoulder_is_monotone_and_ends_at_one() {
        let mut last = -1.0;
        for i in 0..5000 {
            let y = Light::shoulder(i as f32 / 1000.0);
            assert!(y > last || y == 0.0);
            assert!((0.0..1.0).contains(&y));
            last = y;
        }
    }

    #[test]
    fn a_tunnel_is_dark_inside_and_bright_outside() {
        let view = CameraView::new(1, 0, 192, 640);
        let light = Light::new(Preset::Tunnel, 40.0, [0.0; 2], &view);
        let wall = |z| light.shade([0.25; 3], [1.0, 0.0, 0.0], z)[1];
        assert!(wall(12.0) < 0.04 && wall(41.0) > 0.05, "{} {}", wall(12.0), wall(41.0));
    }
}
