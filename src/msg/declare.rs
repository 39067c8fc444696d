//! The macros that declare messages and services.

/// Declares the messages of one ROS package. Doc comments become the comments of the `.msg` text.
///
/// ```text
/// messages! {
///     package diagnostic_msgs;
///
///     /// One part of a robot.
///     message DiagnosticStatus {
///         level: Byte,
///         name: String,
///     }
///     constants { OK: Byte = Byte(0) }
/// }
/// ```
macro_rules! messages {
    (
        package $package:ident;
        $(
            $(#[doc = $doc:literal])*
            message $name:ident { $($fields:tt)* }
            $(constants { $($constants:tt)* })?
        )*
    ) => {
        $($crate::msg::declare::interface! {
            [$package Msg stringify!($name)]
            [$($doc)*]
            $name { $($fields)* } { $($($constants)*)? }
        })*

        /// Every message declared here.
        pub(super) const DEFINITIONS: &[&$crate::msg::Definition] =
            &[$(<$name as $crate::msg::Interface>::DEFINITION),*];
    };
}

/// Declares the services of one ROS package: for each a type that names it, and the structs of its
/// request and response.
macro_rules! services {
    (
        package $package:ident;
        $(
            $(#[doc = $doc:literal])*
            service $service:ident {
                $request:ident { $($request_fields:tt)* }
                $response:ident { $($response_fields:tt)* }
            }
        )*
    ) => {
        $(
            $(#[doc = $doc])*
            #[derive(Debug, Clone, Copy)]
            pub struct $service;

            impl $crate::msg::Service for $service {
                const PACKAGE: &'static str = stringify!($package);
                const NAME: &'static str = stringify!($service);
                type Request = $request;
                type Response = $response;
            }

            $crate::msg::declare::interface! {
                [$package Srv concat!(stringify!($service), "_Request")]
                ["What a client of the service sends."]
                $request { $($request_fields)* } {}
            }
            $crate::msg::declare::interface! {
                [$package Srv concat!(stringify!($service), "_Response")]
                ["What a server of the service answers."]
                $response { $($response_fields)* } {}
            }
        )*

        /// Requests and responses of every service declared here.
        pub(in $crate::msg) const DEFINITIONS: &[&$crate::msg::Definition] = &[$(
            <$request as $crate::msg::Interface>::DEFINITION,
            <$response as $crate::msg::Interface>::DEFINITION,
        )*];
    };
}

/// One struct with its definition: what [`messages`] and [`services`] are made of.
macro_rules! interface {
    (
        [$package:ident $kind:ident $ros_name:expr]
        [$($doc:literal)*]
        $name:ident {
            $($(#[doc = $field_doc:literal])* $field:ident : $ty:ty $(= $default:expr)?),* $(,)?
        }
        {
            $($(#[doc = $constant_doc:literal])* $constant:ident : $constant_ty:ty = $value:expr),* $(,)?
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        pub struct $name {
            $($(#[doc = $field_doc])* pub $field: $ty,)*
        }

        impl $name {
            $($(#[doc = $constant_doc])* pub const $constant: $constant_ty = $value;)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    $($field: $crate::msg::declare::default_value!($($default)?),)*
                }
            }
        }

        impl ros2_client::Message for $name {}

        impl $crate::msg::Interface for $name {
            const DEFINITION: &'static $crate::msg::Definition = &$crate::msg::Definition {
                package: stringify!($package),
                kind: $crate::msg::Kind::$kind,
                name: $ros_name,
                comment: &[$($doc),*],
                constants: &[$($crate::msg::Constant {
                    name: stringify!($constant),
                    ty: <$constant_ty as $crate::msg::Field>::TYPE,
                    value: || <$name>::$constant.to_string(),
                    comment: &[$($constant_doc),*],
                }),*],
                fields: &[$($crate::msg::FieldDefinition {
                    name: $crate::msg::definition::ros_name(stringify!($field)),
                    ty: <$ty as $crate::msg::Field>::TYPE,
                    default: $crate::msg::declare::default_text!($ty $(, $default)?),
                    comment: &[$($field_doc),*],
                }),*],
            };
        }

        impl $crate::msg::Field for $name {
            const TYPE: $crate::msg::FieldType = $crate::msg::FieldType {
                base: $crate::msg::Base::Message(<$name as $crate::msg::Interface>::DEFINITION),
                shape: $crate::msg::Shape::One,
            };
        }
    };
}

macro_rules! default_value {
    () => {
        Default::default()
    };
    ($default:expr) => {
        $default
    };
}

macro_rules! default_text {
    ($ty:ty) => {
        None
    };
    ($ty:ty, $default:expr) => {
        Some(|| {
            let value: $ty = $default;
            value.to_string()
        })
    };
}

pub(super) use {default_text, default_value, interface, messages, services};
