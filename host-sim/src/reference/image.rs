//! Images of an anchor in walls that are shifted and turned, with their slopes and the shift of their mean.
//!
//! With s = u . (a - c) - o, q = t . (a - c), and theta by w = 2 tan(theta / 2), so that dtheta/dw = 1 / (1 + w^2 / 4):
//!
//! m = a - 2 s u,  dm/do = 2 u,  dm/dtheta = -2 (q u + s t),
//! d2m/dtheta2 = 2 (2 s + o) u - 4 q t,  d2m/do dtheta = 2 t.
//!
//! A second wall multiplies by R = I - 2 u u', whose derivative is dR/dtheta = -2 (t u' + u t').

use super::real::Real;
use super::surface::Line;
use super::surface::{dot, less};

/// An image; vectors by wall and by number (offset, rotation).
#[derive(Clone, Debug)]
pub struct Image<T> {
    /// Its position, metres.
    pub position_m: [T; 2],
    /// Its slopes.
    pub slopes: Vec<[[T; 2]; 2]>,
    /// Second derivatives: over both numbers of a wall, over rotation twice.
    curvatures: Vec<[[T; 2]; 2]>,
    /// Derivatives of the first wall's slopes over the second wall's rotation.
    common: Option<[[T; 2]; 2]>,
}

impl<T: Real> Image<T> {
    /// The image of an anchor in walls in order, each with its offset and rotation.
    pub fn of(anchor_m: [T; 2], walls: &[(Line<T>, [T; 2])]) -> Self {
        let num = T::of;
        let two = num(2.0);
        let mut image = Self { position_m: anchor_m, slopes: vec![], curvatures: vec![], common: None };
        for (line, [offset, rotation]) in walls {
            let (centre, normal) = (line.centre_m, line.normal);
            let quarter = num(0.25) * (*rotation * *rotation);
            // d theta / d rotation, and its slope.
            let rate = T::ONE / (T::ONE + quarter);
            let rate_slope = num(-0.5) * (*rotation * (rate * rate));
            let (cos, sin) = ((T::ONE - quarter) * rate, *rotation * rate);
            let u = [cos * normal[0] + sin * -normal[1], cos * normal[1] + sin * normal[0]];
            let t = [-u[1], u[0]];
            let away = less(image.position_m, centre);
            let (s, q) = (dot(u, away) - *offset, dot(t, away));
            let each = |of: &dyn Fn(usize) -> T| [of(0), of(1)];
            let mirrored = |v: [T; 2]| each(&|i| v[i] - two * dot(u, v) * u[i]);
            let turning = |v: [T; 2]| each(&|i| num(-2.0) * rate * (t[i] * dot(u, v) + u[i] * dot(t, v)));
            let turn = each(&|i| num(-2.0) * (q * u[i] + s * t[i]));
            let bend = [two * (two * s + *offset), num(-4.0) * q];
            let twice = each(&|i| rate * rate * (bend[0] * u[i] + bend[1] * t[i]) + rate_slope * turn[i]);
            if let Some(before) = image.slopes.last() {
                image.common = Some(before.map(turning));
            }
            for vectors in image.slopes.iter_mut().chain(&mut image.curvatures) {
                *vectors = vectors.map(mirrored);
            }
            image.position_m = each(&|i| image.position_m[i] - two * s * u[i]);
            image.slopes.push([each(&|i| two * u[i]), each(&|i| rate * turn[i])]);
            image.curvatures.push([each(&|i| two * rate * t[i]), twice]);
        }
        image
    }

    /// Of a private surface: its two numbers are the position.
    pub fn private(position_m: [T; 2]) -> Self {
        let along = [[T::ONE, T::ZERO], [T::ZERO, T::ONE]];
        Self { position_m, slopes: vec![along], curvatures: vec![], common: None }
    }

    /// How far the mean is from there, metres, to the second order: `own` by wall the covariance of offset and rotation, and
    /// the variance of the rotation; `cross` of the second wall's rotation with the first one's offset and rotation.
    pub fn shift_m(&self, own: &[[T; 2]], cross: [T; 2]) -> [T; 2] {
        let mut shift = [T::ZERO; 2];
        for axis in 0..2 {
            for wall in 0..self.curvatures.len() {
                let [both, twice] = self.curvatures[wall];
                shift[axis] += both[axis] * own[wall][0] + T::of(0.5) * (twice[axis] * own[wall][1]);
            }
            if let Some([offset, rotation]) = self.common {
                shift[axis] += offset[axis] * cross[0] + rotation[axis] * cross[1];
            }
        }
        shift
    }
}
