//! Declaration of properties.
//!
//! A property is a plain function of its inputs that panics where it does not hold and returns the
//! declared cases that this evaluation met ([`Seen`]). [`properties!`](crate::properties!) makes of
//! it a Kani harness per `kani` line with a `kani::cover!` per case; a test per `exhaustive`,
//! `stepped` or `sampled` line, which fails when a case was never met; and an entry of
//! [`PROPERTIES`](crate::PROPERTIES), whose `run` a fuzz target can feed.
//!
//! A `theorem` is decided for all its inputs: by Kani harnesses that together leave no input fixed, or
//! by an `exhaustive` test, up to symmetries stated there. Of a configuration each harness frees one group of
//! fields, the others are the first board's; groups together are sampled. A `property` is sampled; its Kani
//! harnesses decide a part of the inputs.
//!
//! No harness assumes anything: a property computes its precondition and returns
//! [`Seen::NOTHING`] where it does not hold (`given!`). A precondition that an earlier stage guarantees is named
//! under `needs` with the property that establishes it.

use crate::input::Bytes;

/// Set of the declared cases that one or several evaluations met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[must_use]
pub struct Seen(u32);

impl Seen {
    /// No case: the property's precondition does not hold.
    pub const NOTHING: Self = Self(0);

    /// Adds case `number` (its index in the declaration, below 32) if `met`.
    pub const fn case(self, number: u32, met: bool) -> Self {
        Self(self.0 | (met as u32) << (number & 31))
    }

    /// Whether case `number` was met.
    #[must_use]
    pub const fn has(self, number: u32) -> bool {
        self.0 >> (number & 31) & 1 != 0
    }

    /// The union.
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// The cases that were met, in the order of their declaration.
macro_rules! seen {
    ($($met:expr),+ $(,)?) => {{
        let seen = ($crate::property::Seen::NOTHING, 0);
        $(let seen = (seen.0.case(seen.1, $met), seen.1 + 1);)+
        seen.0
    }};
}

/// Ends the property where this precondition does not hold.
macro_rules! given {
    (let $pattern:pat = $value:expr) => {
        let $pattern = $value else {
            return $crate::property::Seen::NOTHING;
        };
    };
    ($precondition:expr) => {
        if !$precondition {
            return $crate::property::Seen::NOTHING;
        }
    };
}

/// A declared property.
#[derive(Clone, Copy, Debug)]
pub struct Property {
    /// `theorem` (decided for all inputs) or `property` (sampled).
    pub kind: &'static str,
    /// `T1`, `T2`, …: the group in `docs/proofs.md`.
    pub number: &'static str,
    /// The module path of the property.
    pub area: &'static str,
    /// The property's function.
    pub name: &'static str,
    /// The types of its inputs.
    pub inputs: &'static [&'static str],
    /// Description of each case; every one must be reachable.
    pub cases: &'static [&'static str],
    /// Its Kani harnesses, as `name::harness`.
    pub harnesses: &'static [&'static str],
    /// Its tests: `exhaustive`, `stepped` or `sampled`.
    pub tests: &'static [&'static str],
    /// Properties that establish its preconditions.
    pub needs: &'static [&'static str],
    /// The property on inputs drawn from bytes: for fuzzing.
    pub run: fn(&mut Bytes<'_>) -> Seen,
}

impl Property {
    /// Its Kani harnesses by the names that `cargo kani --exact --harness` takes.
    pub fn kani_names(&self) -> impl Iterator<Item = String> + '_ {
        let area = self.area.trim_start_matches("proofs::");
        self.harnesses
            .iter()
            .filter_map(|harness| harness.split_once("::"))
            .map(move |(name, harness)| format!("{area}::{name}::harness::{harness}"))
    }
}

/// Declares the properties of one area; see the [module](crate::property).
///
/// ```text
/// properties! {
///     theorem T9 missing_edge_is_no_distance(width: u32, lost: bool) {
///         cases ["a distance", "no distance"];
///         needs [another_property];                     // optional
///         kani proof [unwind(2)];                      // every input arbitrary
///         kani lost [unwind(2)] = (any(), true);       // some inputs fixed
///         exhaustive (0..=40_000).map(|width| (width, false));
///         sampled 100_000;
///     }
/// }
/// ```
#[macro_export]
macro_rules! properties {
    ($($kind:ident $number:ident $name:ident $inputs:tt $body:tt)*) => {
        $($crate::property_parts! { $name $inputs $body })*

        /// The properties of this area.
        pub(crate) const PROPERTIES: &[$crate::property::Property] =
            &[$($crate::property_entry! { $kind $number $name $inputs $body }),*];
    };
}

/// One entry of an area's table.
#[doc(hidden)]
#[macro_export]
macro_rules! property_entry {
    ($kind:ident $number:ident $name:ident ($($input:ident : $type:ty),* $(,)?) {
        cases [$($case:literal),+ $(,)?];
        $(needs [$($need:ident),+ $(,)?];)?
        $(kani $harness:ident $attributes:tt $(= $values:expr)?;)*
        $(exhaustive $all:expr;)?
        $(stepped $some:expr;)?
        $(sampled $count:expr;)?
    }) => {
        $crate::property::Property {
            kind: stringify!($kind),
            number: stringify!($number),
            area: module_path!(),
            name: stringify!($name),
            inputs: &[$(stringify!($type)),*],
            cases: &[$($case),+],
            harnesses: &[$(concat!(stringify!($name), "::", stringify!($harness))),*],
            tests: &[
                $({ let _ = stringify!($all); "exhaustive" },)?
                $({ let _ = stringify!($some); "stepped" },)?
                $({ let _: u32 = $count; "sampled" },)?
            ],
            needs: &[$($(stringify!($need)),+)?],
            run: |bytes| $name($(<$type as $crate::input::Input>::draw({ let _ = stringify!($input); &mut *bytes })),*),
        }
    };
}

/// The harnesses and tests of one property.
#[doc(hidden)]
#[macro_export]
macro_rules! property_parts {
    ($name:ident $inputs:tt {
        cases $cases:tt;
        $(needs $needs:tt;)?
        $(kani $harness:ident $attributes:tt $(= $values:expr)?;)*
        $(exhaustive $all:expr;)?
        $(stepped $some:expr;)?
        $(sampled $count:expr;)?
    }) => {
        #[cfg(any(kani, test))]
        #[allow(unused_imports, reason = "an area may need none of its own names here")]
        mod $name {
            use super::*;

            #[cfg(kani)]
            mod harness {
                use super::super::*;
                use $crate::input::any;
                $($crate::property_harness! { $name $inputs $cases $harness $attributes $(= $values)? })*
            }

            $(
                #[cfg(all(test, not(kani)))]
                #[test]
                fn exhaustive() {
                    $crate::property_loop! { $name $inputs $cases ($all) }
                }
            )?
            $(
                #[cfg(all(test, not(kani)))]
                #[test]
                fn stepped() {
                    $crate::property_loop! { $name $inputs $cases ($some) }
                }
            )?
            $(
                #[cfg(all(test, not(kani)))]
                #[test]
                fn sampled() {
                    $crate::property_sample! { $name $inputs $cases $count }
                }
            )?
        }
    };
}

/// One Kani harness: arbitrary inputs, then one cover per case.
#[doc(hidden)]
#[macro_export]
macro_rules! property_harness {
    ($name:ident ($($input:ident : $type:ty),*) $cases:tt $harness:ident $attributes:tt) => {
        $crate::property_harness! {
            $name ($($input : $type),*) $cases $harness $attributes = ($(any::<$type>(),)*)
        }
    };
    (
        $name:ident ($($input:ident : $type:ty),*) [$($case:literal),+ $(,)?]
        $harness:ident [$($attribute:ident($($value:tt)*)),* $(,)?] = $values:expr
    ) => {
        #[kani::proof]
        $(#[kani::$attribute($($value)*)])*
        fn $harness() {
            let ($($input,)*): ($($type,)*) = $values;
            let seen = $name($($input),*);
            let mut number = 0;
            $(
                kani::cover!(seen.has(number), $case);
                number += 1;
            )+
            let _ = number;
        }
    };
}

/// A test over an enumerated set of inputs.
#[doc(hidden)]
#[macro_export]
macro_rules! property_loop {
    ($name:ident ($($input:ident : $type:ty),*) [$($case:literal),+ $(,)?] $all:expr) => {
        let mut seen = $crate::property::Seen::NOTHING;
        for ($($input,)*) in $all {
            seen = seen.and($name($($input),*));
        }
        $crate::sampled::every_case_was_met(seen, &[$($case),+]);
    };
}

/// A test over drawn inputs.
#[doc(hidden)]
#[macro_export]
macro_rules! property_sample {
    ($name:ident ($($input:ident : $type:ty),*) [$($case:literal),+ $(,)?] $count:expr) => {
        $crate::sampled::sample(
            $count,
            &[$($case),+],
            |source| ($(<$type as $crate::input::Input>::draw({ let _ = stringify!($input); &mut *source }),)*),
            |($($input,)*)| $name($($input),*),
        );
    };
}
