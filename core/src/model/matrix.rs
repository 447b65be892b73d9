//! Products of 2 x 2 matrices, each entry a sum in index order: the bits are the same on every machine.

use nalgebra::Matrix2;

/// A B.
pub fn product(a: &Matrix2<f32>, b: &Matrix2<f32>) -> Matrix2<f32> {
    Matrix2::new(
        a.m11 * b.m11 + a.m12 * b.m21,
        a.m11 * b.m12 + a.m12 * b.m22,
        a.m21 * b.m11 + a.m22 * b.m21,
        a.m21 * b.m12 + a.m22 * b.m22,
    )
}

/// A B'.
// Not the product with a transposed copy: on the target that makes the filter's update 1 % longer.
pub fn product_transposed(a: &Matrix2<f32>, b: &Matrix2<f32>) -> Matrix2<f32> {
    Matrix2::new(
        a.m11 * b.m11 + a.m12 * b.m12,
        a.m11 * b.m21 + a.m12 * b.m22,
        a.m21 * b.m11 + a.m22 * b.m12,
        a.m21 * b.m21 + a.m22 * b.m22,
    )
}

/// D C D'.
pub fn sandwiched(d: &Matrix2<f32>, c: &Matrix2<f32>) -> Matrix2<f32> {
    product_transposed(&product(d, c), d)
}
