//! The tunnel without traffic: dark walls, a row of weak lamps, and the open exit, whose light reaches far inside.

use super::hash::{hash, mix, noise, ramp, unit};
use super::light::{Light, Rgb, add, blend, scaled};
use super::street::road;
use super::view::{CAMERA_HEIGHT, CameraView};

/// The positions of the left and the right wall in m.
const WALLS: [f32; 2] = [-6.8, 6.3];
/// The height of the ceiling in m.
const CEILING: f32 = 5.4;

/// The tunnel of one frame.
pub(super) struct Tunnel<'a> {
    pub(super) view: &'a CameraView,
    pub(super) light: &'a Light,
    /// The distance of the open exit in m.
    pub(super) exit: f32,
    /// The distance driven in m.
    pub(super) driven: f32,
    pub(super) seed: u32,
}

impl Tunnel<'_> {
    /// Returns the radiance at a pixel.
    pub(super) fn radiance(&self, row: usize, column: usize) -> Rgb {
        let (u, v) = (column as f32 + 0.5, row as f32 + 0.5);
        let (sx, sy) = ((u - self.view.cx) / self.view.focal, (self.view.cy - v) / self.view.focal);
        let wall = if sx > 0.0 { WALLS[1] / sx } else { WALLS[0] / sx.min(-1e-6) };
        let flat =
            if sy > 0.0 { (CEILING - CAMERA_HEIGHT) / sy.max(1e-6) } else { CAMERA_HEIGHT / (-sy).max(1e-6) };
        // The nearest plane along the ray is the visible one.
        let z = wall.min(flat).min(400.0);
        if flat <= wall && sy <= 0.0 {
            return self.floor(sx * z, z);
        }
        let inside = self.lining(sx * z, CAMERA_HEIGHT + sy * z, z, flat < wall);
        let open = self.opening(sx, sy);
        if open == 0.0 { inside } else { blend(inside, self.outside(u, v, sx * z, z), open) }
    }

    /// Returns 1 well inside the exit, 0 well outside, smooth over some pixels.
    fn opening(&self, sx: f32, sy: f32) -> f32 {
        let (x, y) = (sx * self.exit, CAMERA_HEIGHT + sy * self.exit);
        let side = (x - WALLS[0]).min(WALLS[1] - x);
        let inner = side.min(CEILING - y);
        let corner = 1.3 - side.min(1.3);
        let rounded = inner.min(CEILING - y - 0.55 * corner * corner);
        let soft = 6.0 * self.view.scale() * self.exit / self.view.focal;
        ramp(-soft, soft, rounded)
    }

    /// Returns the radiance beyond the exit: bright sky, hazy hills, trees.
    fn outside(&self, u: f32, v: f32, x: f32, z: f32) -> Rgb {
        let s = self.view.scale();
        let above = (self.view.cy - v) / s;
        let hills =
            5.0 + 12.0 * noise(u / s / 30.0, 1.0, self.seed) + 4.0 * noise(u / s / 7.0, 2.0, self.seed);
        let sky = self.light.sky(u, v, self.view);
        let cloud = 0.05 * noise(u / s / 20.0, above / 9.0, self.seed ^ 7);
        let bank = [0.33, 0.37, 0.33];
        let leaf = 0.08 * noise(u / s / 5.0, v / s / 5.0, self.seed ^ 9);
        let far = blend(add(sky, [cloud; 3]), add(bank, [leaf; 3]), ramp(-2.5, 2.5, hills - above));
        if above > 0.0 { far } else { blend(far, self.floor(x, z), 0.5) }
    }

    fn floor(&self, x: f32, z: f32) -> Rgb {
        let pixel = z / self.view.focal;
        let albedo = road(
            x,
            z + self.driven,
            z * pixel / CAMERA_HEIGHT,
            pixel,
            [WALLS[0] - 0.3, WALLS[1] + 1.4],
            self.seed,
        );
        let beyond = ramp(-9.0, 12.0, z - self.exit);
        let bright = add(self.light.shade(albedo, [0.0, 1.0, 0.0], self.exit.max(z)), [0.20, 0.21, 0.21]);
        blend(self.light.shade(albedo, [0.0, 1.0, 0.0], z.min(self.exit)), bright, beyond)
    }

    /// Returns the radiance of wall or ceiling: slabs with joints, a painted band, lamps overhead.
    fn lining(&self, x: f32, y: f32, z: f32, overhead: bool) -> Rgb {
        let z = z.min(self.exit);
        let along = (z + self.driven) / 4.0;
        let soft = (0.25 * z * z / (self.view.focal * 6.0)).clamp(0.015, 0.5);
        let t = along - along.floor();
        let joint = ramp(-soft, soft, 0.02 + soft * 0.3 - t.min(1.0 - t)) * (1.0 - ramp(0.1, 0.5, soft));
        let slab = 0.85 + 0.3 * unit(hash(along.floor() as i32 as u32, 0, self.seed));
        let stain = 0.75 + 0.5 * noise(along * 4.0, if overhead { x } else { y }, self.seed);
        let band = if overhead { 0.0 } else { ramp(-0.1, 0.1, 1.0 - (y - 0.6).abs() * 2.0) };
        let base = mix(0.30, 0.52, band) * mix(slab, 1.0, ramp(0.1, 0.5, soft)) * stain * (1.0 - 0.5 * joint);
        let normal = if overhead { [0.0, -1.0, 0.0] } else { [-x.signum(), 0.0, 0.0] };
        let lit = self.light.shade([base, base * 0.97, base * 0.88], normal, z);
        if overhead { add(lit, self.lamps(x, along, soft)) } else { lit }
    }

    /// Returns the radiance of the strip lamps along the ceiling.
    fn lamps(&self, x: f32, along: f32, soft: f32) -> Rgb {
        let t = along / 2.0 - (along / 2.0).floor();
        let on = mix(ramp(0.0, 0.22, 0.36 - (t - 0.5).abs()), 0.7, ramp(0.05, 0.3, soft));
        let near = ((x + 2.0).abs()).min((x - 1.8).abs());
        scaled([0.17, 0.13, 0.07], on * (1.0 - ramp(0.10, 0.75, near)))
    }
}
