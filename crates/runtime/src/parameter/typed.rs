//! [`parameters!`](crate::parameters): a struct of typed parameters, each declared once with its type, default, range
//! and help. The parameter services, `--help`, launch checks and `docs/reference/parameters.md` read the same declaration.

use std::ops::RangeInclusive;

use super::{Allowed, Descriptor, ParameterError, Parameters, Value};

/// A struct whose fields are parameters, made by [`parameters!`](crate::parameters).
pub trait ParameterSet: Default + for<'a> From<&'a Parameters> {
    /// Returns the declarations of all fields, in order.
    fn descriptors() -> Vec<Descriptor>;

    /// Returns the values of all fields, in the order of [`ParameterSet::descriptors`].
    fn values(&self) -> Vec<Value>;

    /// Checks every field against its declaration. Fields are public, so a node calls this before it uses them.
    ///
    /// # Errors
    /// [`ParameterError`] of the first value that is out of its range.
    fn check(&self) -> Result<(), ParameterError> {
        // The declaration that the services use is the one that is checked here, so that both accept the same values.
        self.declared().into_iter().try_for_each(|(descriptor, value)| descriptor.accept(value).map(|_| ()))
    }

    /// Returns the declarations of all fields with their values, in order.
    fn declared(&self) -> Vec<(Descriptor, Value)> {
        Self::descriptors().into_iter().zip(self.values()).collect()
    }

    /// Returns this set with the declared default of the parameters of these names.
    fn reset(&self, names: &[&str]) -> Self {
        let mut all = Parameters::declare(Self::descriptors());
        for (descriptor, value) in self.declared() {
            if !names.contains(&descriptor.name) {
                all.values.insert(descriptor.name, value);
            }
        }
        Self::from(&all)
    }

    /// Returns the set that (name, text) pairs give; every other parameter has its default.
    ///
    /// # Errors
    /// [`ParameterError`] of the first pair that is not possible.
    fn from_text<S: AsRef<str>>(pairs: &[(S, S)]) -> Result<Self, ParameterError> {
        Ok(Self::from(&Parameters::declare(Self::descriptors()).with_text(pairs)?))
    }

    /// Returns all parameters as (name, text), which [`ParameterSet::from_text`] reads back to an equal set.
    fn to_text(&self) -> Vec<(&'static str, String)> {
        let all = self.declared().into_iter();
        all.map(|(descriptor, value)| (descriptor.name, value.to_yaml())).collect()
    }
}

/// The possible values of a field of type `T`, and the form of each of them as a [`Value`].
pub trait Rule<T> {
    /// Returns the rule as a descriptor has it.
    fn allowed(&self) -> Allowed;
    /// Returns the value of `field`. A `usize` beyond `i64` becomes the largest `i64`.
    fn value(&self, field: &T) -> Value;
    /// Returns the field that [`Rule::value`] writes as `value`.
    fn field(&self, value: &Value) -> Option<T>;
}

/// The rule of a parameter that can have any value of its type.
pub struct AnyValue;

macro_rules! any_value {
    ($($type:ty: $kind:ident),*) => {$(
        impl Rule<$type> for AnyValue {
            fn allowed(&self) -> Allowed {
                Allowed::Any
            }

            fn value(&self, field: &$type) -> Value {
                Value::$kind(field.clone())
            }

            fn field(&self, value: &Value) -> Option<$type> {
                if let Value::$kind(value) = value { Some(value.clone()) } else { None }
            }
        }
    )*};
}
any_value!(bool: Bool, String: String, Vec<String>: Strings);

/// The types of numbers of fields, each with the form of its values.
pub trait Number: Copy + PartialOrd {
    /// Returns the allowed values from `least` to `most`.
    fn allowed(least: Self, most: Self) -> Allowed;
    /// Returns the number as a value.
    fn value(self) -> Value;
    /// Returns the number that [`Number::value`] gives as `value`.
    fn of(value: &Value) -> Option<Self>;
}

impl Number for f64 {
    fn allowed(least: Self, most: Self) -> Allowed {
        Allowed::Doubles(least..=most)
    }

    fn value(self) -> Value {
        Value::Double(self)
    }

    fn of(value: &Value) -> Option<Self> {
        if let Value::Double(value) = value { Some(*value) } else { None }
    }
}

macro_rules! integers {
    ($($type:ty)+) => {$(
        impl Number for $type {
            fn allowed(least: Self, most: Self) -> Allowed {
                let bound = |value: Self| i64::try_from(value).unwrap_or(i64::MAX);
                Allowed::Integers(bound(least)..=bound(most))
            }

            fn value(self) -> Value {
                Value::Integer(i64::try_from(self).unwrap_or(i64::MAX))
            }

            fn of(value: &Value) -> Option<Self> {
                if let Value::Integer(value) = value { Self::try_from(*value).ok() } else { None }
            }
        }
    )+};
}
integers!(u8 i64 usize);

impl<T: Number> Rule<T> for RangeInclusive<T> {
    fn allowed(&self) -> Allowed {
        T::allowed(*self.start(), *self.end())
    }

    fn value(&self, field: &T) -> Value {
        field.value()
    }

    fn field(&self, value: &Value) -> Option<T> {
        T::of(value)
    }
}

/// The rule of a field that need not be set, which its least value stands for.
impl<T: Number> Rule<Option<T>> for RangeInclusive<T> {
    fn allowed(&self) -> Allowed {
        Rule::<T>::allowed(self)
    }

    fn value(&self, field: &Option<T>) -> Value {
        field.unwrap_or(*self.start()).value()
    }

    fn field(&self, value: &Value) -> Option<Option<T>> {
        Some(Some(T::of(value)?).filter(|value| value > self.start()))
    }
}

/// Words, each with the field that it stands for.
impl<T: Copy + PartialEq, const N: usize> Rule<T> for [(&'static str, T); N] {
    fn allowed(&self) -> Allowed {
        Allowed::Words(self.iter().map(|(word, _)| *word).collect())
    }

    fn value(&self, field: &T) -> Value {
        let word = self.iter().find(|(_, meant)| meant == field).map(|(word, _)| *word);
        Value::String(word.expect("a rule has a word for every variant").to_owned())
    }

    fn field(&self, value: &Value) -> Option<T> {
        let Value::String(value) = value else { return None };
        self.iter().find(|(word, _)| word == value).map(|(_, meant)| *meant)
    }
}

/// Returns the field `name` of a typed set.
///
/// # Panics
/// When `parameters` were not declared by that set: an error in the code that runs the node.
pub fn field<T>(parameters: &Parameters, name: &str, rule: &impl Rule<T>) -> T {
    let value = parameters.get(name).and_then(|value| rule.field(value));
    value.expect("the set holds a value that its own declaration allows")
}

/// Returns the name of a field; `r#loop` is the parameter `loop`.
pub fn name_of(field: &'static str) -> &'static str {
    field.strip_prefix("r#").unwrap_or(field)
}

/// Declares a struct of parameters with the methods of [`ParameterSet`].
///
/// A field is `name: type = default => rule; fixed`. Its doc comment is the help of the parameter. The rule is a range
/// (`1..=16`, of the field's type; of an `Option`, its least value is None), or an array of `("word", value)` for an enum; it is left out for `bool`, `String`
/// and `Vec<String>`, which can have any value. `fixed` parameters cannot change after the start. After the fields,
/// `..name: Type` includes the parameters of another set.
///
/// ```
/// modulo_runtime::parameters! {
///     /// The parameters of a fan.
///     pub struct FanParameters {
///         /// Speed of the fan, in turns per second.
///         speed: f64 = 2.0 => 0.0..=50.0,
///         /// Number of blades.
///         blades: u8 = 3 => 1..=12; fixed,
///     }
/// }
/// use modulo_runtime::ParameterSet as _;
///
/// let fan = FanParameters::from_text(&[("speed", "4")]).expect("4 is in the range");
/// assert_eq!(fan, FanParameters { speed: 4.0, blades: 3 });
/// assert!(FanParameters { speed: -4.0, ..fan }.check().is_err());
/// ```
#[macro_export]
macro_rules! parameters {
    (@rule) => { $crate::parameter::typed::AnyValue };
    (@rule $rule:expr) => { $rule };
    (@fixed) => { false };
    (@fixed fixed) => { true };
    (
        $(#[$about:meta])*
        pub struct $set:ident {
            $(
                $(#[doc = $help:literal])+
                $field:ident: $type:ty = $default:expr $(=> $rule:expr)? $(; $fixed:ident)?,
            )*
            $(..$group:ident: $group_set:ty,)*
        }
    ) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $set {
            $($(#[doc = $help])+ pub $field: $type,)*
            $(#[doc = concat!("The parameters of [`", stringify!($group_set), "`].")] pub $group: $group_set,)*
        }

        impl Default for $set {
            fn default() -> Self {
                Self { $($field: $default,)* $($group: <$group_set>::default(),)* }
            }
        }

        impl $crate::ParameterSet for $set {
            fn descriptors() -> Vec<$crate::Descriptor> {
                use $crate::parameter::typed::{Rule, name_of};
                #[allow(unused_mut)]
                let mut all = vec![$({
                    let (rule, default): (_, $type) = ($crate::parameters!(@rule $($rule)?), $default);
                    $crate::Descriptor {
                        name: name_of(stringify!($field)),
                        default: Rule::<$type>::value(&rule, &default),
                        allowed: Rule::<$type>::allowed(&rule),
                        read_only: $crate::parameters!(@fixed $($fixed)?),
                        description: concat!($($help),+).trim(),
                    }
                }),*];
                $(all.extend(<$group_set as $crate::ParameterSet>::descriptors());)*
                all
            }

            fn values(&self) -> Vec<$crate::Value> {
                use $crate::parameter::typed::Rule;
                #[allow(unused_mut)]
                let mut all = vec![$(Rule::<$type>::value(&$crate::parameters!(@rule $($rule)?), &self.$field)),*];
                $(all.extend($crate::ParameterSet::values(&self.$group));)*
                all
            }
        }

        impl From<&$crate::Parameters> for $set {
            fn from(parameters: &$crate::Parameters) -> Self {
                use $crate::parameter::typed::{field, name_of};
                Self {
                    $($field: field::<$type>(
                        parameters,
                        name_of(stringify!($field)),
                        &$crate::parameters!(@rule $($rule)?),
                    ),)*
                    $($group: <$group_set>::from(parameters),)*
                }
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::super::sample::{Part, Set};
    use super::*;

    #[test]
    fn a_struct_declares_each_parameter_once() {
        let all = Set::descriptors();
        let names: Vec<_> = all.iter().map(|d| d.name).collect();
        assert_eq!(names, ["angle", "bits", "engine", "wait_for", "model", "loop", "share"]);
        assert_eq!(all[1].allowed, Allowed::Integers(1..=16));
        assert_eq!(all[2].allowed, Allowed::Words(vec!["auto", "ort", "rten"]));
        assert_eq!((&all[2].default, &all[3].allowed), (&Value::String("auto".into()), &Allowed::Any));
        assert_eq!(all[6].description, "Two lines of help are one sentence.");
        assert_eq!(all.iter().filter(|d| d.read_only).map(|d| d.name).collect::<Vec<_>>(), ["bits", "model"]);
        assert_eq!(Set::from(&Parameters::declare(all)), Set::default());
    }

    #[test]
    fn what_is_written_as_text_reads_back() {
        let (part, wait_for) = (Part { share: 1.0 / 3.0 }, vec!["a, b".to_owned(), "'".to_owned()]);
        let set = Set { angle: 7.0, bits: 9, engine: 2, wait_for, model: "".into(), r#loop: true, part };
        let text = set.to_text();
        let pairs: Vec<_> = text.iter().map(|(name, text)| (*name, text.as_str())).collect();
        assert_eq!(Set::from_text(&pairs), Ok(set));
    }

    #[test]
    fn a_field_out_of_its_range_is_refused() {
        for (set, named) in [
            (Set { bits: 0, ..Set::default() }, "'bits' = 0: must be in 1 to 16"),
            (Set { angle: -1.0, ..Set::default() }, "'angle' = -1: must be a finite number"),
            (
                Set { part: Part { share: f64::NAN }, ..Set::default() },
                "'share' = NaN: must be a finite number in 0 to 1",
            ),
        ] {
            assert!(set.check().expect_err(named).to_string().contains(named), "{set:?}");
        }
        let integers: &dyn Rule<usize> = &(1..=9);
        assert_eq!(integers.value(&usize::MAX), Value::Integer(i64::MAX));
    }
}
