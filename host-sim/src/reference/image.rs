//! TEMPORARY: until the one of branch `avail` is here.

use super::Square;
use super::real::{Real, square};
use super::surface::{Line, Surface};

/// An image.
#[derive(Clone, Copy, Debug)]
pub struct Image<T> {
    /// Position.
    pub position_m: [T; 2],
    /// Slopes.
    pub slopes: [Square<T>; 2],
    bends: [[[T; 2]; 2]; 2],
    common: Square<T>,
}

impl<T: Real> Image<T> {
    /// Of what moves with nothing.
    pub fn still(position_m: [T; 2]) -> Self {
        let none = [[T::ZERO; 2]; 2];
        Self { position_m, slopes: [none; 2], bends: [none; 2], common: none }
    }

    /// In one surface.
    pub fn first(anchor_m: [T; 2], surface: &Surface<T>, state: [T; 2]) -> Self {
        let mut image = Self::still(anchor_m);
        match surface {
            Surface::Private => {
                image.position_m = state;
                image.slopes[0] = [[T::ONE, T::ZERO], [T::ZERO, T::ONE]];
            }
            Surface::Wall(line) => {
                (image.position_m, image.slopes[0], image.bends[0]) = reflect(line, state, anchor_m);
            }
        }
        image
    }

    /// In a second one.
    pub fn second(&self, surface: &Surface<T>, state: [T; 2]) -> Self {
        let Surface::Wall(line) = surface else { return *self };
        let num = T::of;
        let turned = line.moved(T::ZERO, state[1]);
        let (u, t) = (turned.normal, turned.tangent());
        let mut image = *self;
        (image.position_m, image.slopes[1], image.bends[1]) = reflect(line, state, self.position_m);
        let rate = T::ONE / (T::ONE + num(0.25) * square(state[1]));
        let mirrored = |v: [T; 2]| {
            let twice = num(2.0) * (u[0] * v[0] + u[1] * v[1]);
            [v[0] - twice * u[0], v[1] - twice * u[1]]
        };
        for column in 0..2 {
            let v = [self.slopes[0][0][column], self.slopes[0][1][column]];
            let w = mirrored(v);
            let (along_u, along_t) = (u[0] * v[0] + u[1] * v[1], t[0] * v[0] + t[1] * v[1]);
            for row in 0..2 {
                image.slopes[0][row][column] = w[row];
                image.common[row][column] = num(-2.0) * rate * (t[row] * along_u + u[row] * along_t);
            }
            image.bends[0][column] = mirrored(self.bends[0][column]);
        }
        image
    }

    /// Shift of the mean.
    pub fn shift_m(&self, own: &[Square<T>; 2], cross: &Square<T>) -> [T; 2] {
        let mut shift = [T::ZERO; 2];
        for axis in 0..2 {
            for surface in 0..2 {
                let [common, twice] = self.bends[surface];
                shift[axis] +=
                    common[axis] * own[surface][1][0] + T::of(0.5) * (twice[axis] * own[surface][1][1]);
            }
            shift[axis] += self.common[axis][0] * cross[0][1] + self.common[axis][1] * cross[1][1];
        }
        shift
    }
}

fn reflect<T: Real>(line: &Line<T>, state: [T; 2], point_m: [T; 2]) -> ([T; 2], Square<T>, [[T; 2]; 2]) {
    let num = T::of;
    let turned = line.moved(T::ZERO, state[1]);
    let (u, t) = (turned.normal, turned.tangent());
    let d = [point_m[0] - line.centre_m[0], point_m[1] - line.centre_m[1]];
    let s = u[0] * d[0] + u[1] * d[1] - state[0];
    let q = t[0] * d[0] + t[1] * d[1];
    let rate = T::ONE / (T::ONE + num(0.25) * square(state[1]));
    let rate_slope = num(-0.5) * (state[1] * square(rate));
    let (mut position, mut slope, mut bends) = ([T::ZERO; 2], [[T::ZERO; 2]; 2], [[T::ZERO; 2]; 2]);
    for axis in 0..2 {
        position[axis] = point_m[axis] - num(2.0) * s * u[axis];
        let turn = num(-2.0) * (q * u[axis] + s * t[axis]);
        slope[axis] = [num(2.0) * u[axis], rate * turn];
        bends[0][axis] = num(2.0) * rate * t[axis];
        let second = num(2.0) * (num(2.0) * s + state[0]) * u[axis] + num(-4.0) * q * t[axis];
        bends[1][axis] = square(rate) * second + rate_slope * turn;
    }
    (position, slope, bends)
}
