//! The macros that declare messages, services and actions.

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

/// Declares an action of a ROS package, in a module of its own: a type that names it, `Goal`, `Outcome` and
/// `Feedback` as declared, and the messages that carry them.
macro_rules! action {
    (
        package $package:ident;
        $(#[doc = $doc:literal])*
        action $action:ident {
            goal { $($goal:tt)* }
            outcome { $($outcome:tt)* }
            feedback { $($feedback:tt)* }
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy)]
        pub struct $action;

        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_Goal")]
            ["What a client of the action asks for."]
            Goal { $($goal)* } {}
        }
        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_Result")]
            ["What it gets in the end."]
            Outcome { $($outcome)* } {}
        }
        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_Feedback")]
            ["What it is told meanwhile."]
            Feedback { $($feedback)* } {}
        }

        /// The service that takes goals.
        #[derive(Debug, Clone, Copy)]
        pub struct SendGoal;

        impl $crate::msg::Service for SendGoal {
            const PACKAGE: &'static str = stringify!($package);
            const NAME: &'static str = concat!(stringify!($action), "_SendGoal");
            type Request = SendGoalRequest;
            type Response = SendGoalResponse;
        }

        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_SendGoal_Request")]
            ["A goal."]
            SendGoalRequest {
                /// The client's choice.
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
                /// The goal.
                goal: Goal,
            } {}
        }
        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_SendGoal_Response")]
            ["Whether it is taken."]
            SendGoalResponse {
                /// It is.
                accepted: bool,
                /// When.
                stamp: $crate::msg::builtin_interfaces::Time,
            } {}
        }

        /// The service that gives outcomes, each when it is there.
        #[derive(Debug, Clone, Copy)]
        pub struct GetResult;

        impl $crate::msg::Service for GetResult {
            const PACKAGE: &'static str = stringify!($package);
            const NAME: &'static str = concat!(stringify!($action), "_GetResult");
            type Request = GetResultRequest;
            type Response = GetResultResponse;
        }

        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_GetResult_Request")]
            ["Which outcome."]
            GetResultRequest {
                /// That of this goal.
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
            } {}
        }
        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_GetResult_Response")]
            ["An outcome."]
            GetResultResponse {
                /// A constant of `action_msgs/GoalStatus`.
                status: i8,
                /// The outcome.
                result: Outcome,
            } {}
        }
        $crate::msg::declare::interface! {
            [$package Action concat!(stringify!($action), "_FeedbackMessage")]
            ["Feedback of a goal."]
            FeedbackMessage {
                /// Which goal.
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
                /// The feedback.
                feedback: Feedback,
            } {}
        }

        impl $crate::msg::Action for $action {
            type Goal = Goal;
            type Outcome = Outcome;
            type Feedback = Feedback;
            type SendGoal = SendGoal;
            type GetResult = GetResult;
            type FeedbackMessage = FeedbackMessage;

            fn goal(r: SendGoalRequest) -> ($crate::msg::unique_identifier_msgs::UUID, Goal) {
                (r.goal_id, r.goal)
            }

            fn taken(
                accepted: bool,
                stamp: $crate::msg::builtin_interfaces::Time,
            ) -> SendGoalResponse {
                SendGoalResponse { accepted, stamp }
            }

            fn asked(r: GetResultRequest) -> $crate::msg::unique_identifier_msgs::UUID {
                r.goal_id
            }

            fn ended(status: i8, result: Outcome) -> GetResultResponse {
                GetResultResponse { status, result }
            }

            fn told(
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
                feedback: Feedback,
            ) -> FeedbackMessage {
                FeedbackMessage { goal_id, feedback }
            }
        }

        /// Every message declared here.
        pub(in $crate::msg) const DEFINITIONS: &[&$crate::msg::Definition] = &[
            <Goal as $crate::msg::Interface>::DEFINITION,
            <Outcome as $crate::msg::Interface>::DEFINITION,
            <Feedback as $crate::msg::Interface>::DEFINITION,
            <SendGoalRequest as $crate::msg::Interface>::DEFINITION,
            <SendGoalResponse as $crate::msg::Interface>::DEFINITION,
            <GetResultRequest as $crate::msg::Interface>::DEFINITION,
            <GetResultResponse as $crate::msg::Interface>::DEFINITION,
            <FeedbackMessage as $crate::msg::Interface>::DEFINITION,
        ];
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

pub(super) use {action, default_text, default_value, interface, messages, services};
