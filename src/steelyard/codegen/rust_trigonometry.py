"""Sine and cosine in Rust for computers without a standard library."""

__all__ = ["TRIGONOMETRY"]

# Reduction by a multiple of pi/2 in three parts (33, 33 and 53 bits: the products with the first two are exact), then
# Taylor series on [-pi/4, pi/4] to orders 17 and 16, with the reduced angle as a sum of two numbers.
TRIGONOMETRY = """
//! Sine and cosine: of the standard library, or in plain arithmetic where there is none.

#[cfg(feature = "std")]
extern crate std;

#[cfg(feature = "std")]
pub(crate) fn sin_cos(x: f64) -> (f64, f64) {
    x.sin_cos()
}

/// Within 1e-15 up to a million radians; beyond, and where `x` is not a number, the results are not numbers.
#[cfg(not(feature = "std"))]
pub(crate) fn sin_cos(x: f64) -> (f64, f64) {
    if !(x > -1.0e6 && x < 1.0e6) {
        return (f64::NAN, f64::NAN);
    }
    let turns = x * core::f64::consts::FRAC_2_PI;
    let quadrant = (if turns < 0.0 { turns - 0.5 } else { turns + 0.5 }) as i32;
    let whole = f64::from(quadrant);
    let (high, error) = difference(x - whole * 1.5707963267341256, whole * 6.077100506303966e-11);
    let (r, low) = difference(high, whole * 2.0222662487959506e-21 - error);

    let square = r * r;
    let mut sine = 2.8114572543455206e-15;
    sine = sine * square - 7.647163731819816e-13;
    sine = sine * square + 1.6059043836821613e-10;
    sine = sine * square - 2.505210838544172e-08;
    sine = sine * square + 2.7557319223985893e-06;
    sine = sine * square - 0.0001984126984126984;
    sine = sine * square + 0.008333333333333333;
    sine = sine * square - 0.16666666666666666;
    sine = r + (r * square * sine + low * (1.0 - 0.5 * square));

    let mut cosine = 4.779477332387385e-14;
    cosine = cosine * square - 1.1470745597729725e-11;
    cosine = cosine * square + 2.08767569878681e-09;
    cosine = cosine * square - 2.755731922398589e-07;
    cosine = cosine * square + 2.48015873015873e-05;
    cosine = cosine * square - 0.001388888888888889;
    cosine = cosine * square + 0.041666666666666664;
    let main = 1.0 - 0.5 * square;
    let lost = (1.0 - main) - 0.5 * square;
    cosine = main + (square * square * cosine + lost - r * low);

    match quadrant & 3 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// Return a - b rounded, and what the rounding lost.
#[cfg(not(feature = "std"))]
fn difference(a: f64, b: f64) -> (f64, f64) {
    let result = a - b;
    let part = a - result;
    (result, (a - (result + part)) + (part - b))
}
"""
