"""Square root in Rust for computers without a standard library."""

__all__ = ["SQUARE_ROOT"]

# Half the exponent is a first guess within 4 percent; each of Heron's steps doubles the correct digits.
SQUARE_ROOT = """
//! Square root: of the standard library, or in plain arithmetic where there is none.

#[cfg(feature = "std")]
extern crate std;

#[cfg(feature = "std")]
pub(crate) fn sqrt(x: f64) -> f64 {
    x.sqrt()
}

/// Within one unit in the last place; not a number where `x` is negative or not a number.
#[cfg(not(feature = "std"))]
pub(crate) fn sqrt(x: f64) -> f64 {
    if !(x > 0.0 && x < f64::INFINITY) {
        return if x < 0.0 { f64::NAN } else { x };
    }
    let (x, scale) = if x < 1.0e-290 {
        (x * 3.402823669209385e38, 5.421010862427522e-20)
    } else {
        (x, 1.0)
    };
    let mut root = f64::from_bits((x.to_bits() >> 1) + 0x1ff7_a3be_a91d_9b1b);
    root = 0.5 * (root + x / root);
    root = 0.5 * (root + x / root);
    root = 0.5 * (root + x / root);
    root = 0.5 * (root + x / root);
    root * scale
}
"""
