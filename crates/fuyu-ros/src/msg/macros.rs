//! Macros that declare messages, services and actions: [`messages`](crate::messages), [`services`](crate::services),
//! [`action`](crate::action).

/// Declares the messages of one ROS package: for each a struct that implements [`Interface`](crate::msg::Interface).
///
/// Doc comments become the comments of the `.msg` text. A field type is a Rust number, `bool`, `String`,
/// [`Byte`](crate::msg::Byte), another message, `Vec<T>`, `[T; N]` or [`Bounded<T, N>`](crate::msg::Bounded). A field may
/// have a default, a message may have constants. `DEFINITIONS` lists all messages of the module. Type hash and `.msg` text
/// follow from the declaration, so it must agree with the `.msg` file that other ROS nodes use.
///
/// `fuyu_ros` must be a dependency under this name. Use one module per ROS package.
///
/// ```
/// mod acme_msgs {
///     use fuyu_ros::msg::std_msgs::Header;
///
///     fuyu_ros::messages! {
///         package acme_msgs;
///
///         /// Temperature of one motor.
///         message MotorTemperature {
///             /// Time of the measurement.
///             header: Header,
///             /// Name of the joint.
///             joint: String,
///             /// Temperature \[deg C\].
///             temperature: f64 = 20.0,
///             /// OK or HOT.
///             state: u8,
///         }
///         constants {
///             /// Below the limit.
///             OK: u8 = 0,
///             /// Above the limit.
///             HOT: u8 = 1,
///         }
///     }
/// }
/// use acme_msgs::MotorTemperature;
/// use fuyu_ros::msg::{Interface, cdr};
///
/// let hot = MotorTemperature {
///     joint: "shoulder".into(),
///     state: MotorTemperature::HOT,
///     ..Default::default()
/// };
/// assert_eq!(hot.temperature, 20.0);
/// let bytes = cdr::encode(&hot);
/// assert_eq!(cdr::decode::<MotorTemperature>(&bytes)?, hot);
///
/// let definition = MotorTemperature::DEFINITION;
/// assert_eq!(definition.type_name(), "acme_msgs/msg/MotorTemperature");
/// assert!(definition.msg_text().contains("uint8 HOT=1\n"));
/// # Ok::<(), cdr::CdrError>(())
/// ```
#[macro_export]
macro_rules! messages {
    (
        package $package:ident;
        $(
            $(#[doc = $doc:literal])*
            message $name:ident { $($fields:tt)* }
            $(constants { $($constants:tt)* })?
        )*
    ) => {
        $($crate::__message! {
            [$package Msg stringify!($name)]
            [$($doc)*]
            $name { $($fields)* } { $($($constants)*)? }
        })*

        /// Every message declared here.
        #[allow(dead_code)]
        pub const DEFINITIONS: &[&$crate::msg::Definition] =
            &[$(<$name as $crate::msg::Interface>::DEFINITION),*];
    };
}

/// Declares the services of one ROS package: for each a type that implements [`Service`](crate::msg::Service), and the
/// structs of its request and response.
///
/// ```
/// mod acme_srvs {
///     fuyu_ros::services! {
///         package acme_srvs;
///
///         /// Moves one joint of the gripper.
///         service MoveJoint {
///             MoveJointRequest {
///                 /// Goal \[rad\].
///                 position: f64,
///             }
///             MoveJointResponse {
///                 /// Whether the goal is within the limits.
///                 accepted: bool,
///             }
///         }
///     }
/// }
/// use fuyu_ros::msg::{Interface, Service};
///
/// assert_eq!(acme_srvs::MoveJoint::NAME, "MoveJoint");
/// let request = acme_srvs::MoveJointRequest::DEFINITION;
/// assert_eq!(request.type_name(), "acme_srvs/srv/MoveJoint_Request");
/// ```
#[macro_export]
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

            $crate::__message! {
                [$package Srv concat!(stringify!($service), "_Request")]
                ["Request of the service."]
                $request { $($request_fields)* } {}
            }
            $crate::__message! {
                [$package Srv concat!(stringify!($service), "_Response")]
                ["Response of the service."]
                $response { $($response_fields)* } {}
            }
        )*

        /// Requests and responses of every service declared here.
        #[allow(dead_code)]
        pub const DEFINITIONS: &[&$crate::msg::Definition] = &[$(
            <$request as $crate::msg::Interface>::DEFINITION,
            <$response as $crate::msg::Interface>::DEFINITION,
        )*];
    };
}

/// Declares an action: a type that implements [`Action`](crate::msg::Action), the structs `Goal`, `Outcome` (the result)
/// and `Feedback`, and the services and messages that carry them. Use one module per action, since the names of the
/// structs are fixed.
///
/// ```
/// mod dock {
///     fuyu_ros::action! {
///         package acme_actions;
///
///         /// Docks with the station.
///         action Dock {
///             goal {
///                 /// Number of the port.
///                 port: u8,
///             }
///             outcome {
///                 /// Whether the latches are closed.
///                 latched: bool,
///             }
///             feedback {
///                 /// Distance to the port \[m\].
///                 distance: f64,
///             }
///         }
///     }
/// }
/// use fuyu_ros::msg::Interface;
///
/// assert_eq!(dock::Goal::DEFINITION.type_name(), "acme_actions/action/Dock_Goal");
/// ```
#[macro_export]
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

        $crate::__message! {
            [$package Action concat!(stringify!($action), "_Goal")]
            ["Goal of the action."]
            Goal { $($goal)* } {}
        }
        $crate::__message! {
            [$package Action concat!(stringify!($action), "_Result")]
            ["Result of the action."]
            Outcome { $($outcome)* } {}
        }
        $crate::__message! {
            [$package Action concat!(stringify!($action), "_Feedback")]
            ["Progress towards the goal."]
            Feedback { $($feedback)* } {}
        }

        /// The service that receives goals.
        #[derive(Debug, Clone, Copy)]
        pub struct SendGoal;

        impl $crate::msg::Service for SendGoal {
            const PACKAGE: &'static str = stringify!($package);
            const NAME: &'static str = concat!(stringify!($action), "_SendGoal");
            type Request = SendGoalRequest;
            type Response = SendGoalResponse;
        }

        $crate::__message! {
            [$package Action concat!(stringify!($action), "_SendGoal_Request")]
            ["A goal with its id."]
            SendGoalRequest {
                /// Id of the goal, chosen by the client.
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
                /// The goal.
                goal: Goal,
            } {}
        }
        $crate::__message! {
            [$package Action concat!(stringify!($action), "_SendGoal_Response")]
            ["Whether the server accepts the goal."]
            SendGoalResponse {
                /// Whether the goal is accepted.
                accepted: bool,
                /// Time of acceptance.
                stamp: $crate::msg::builtin_interfaces::Time,
            } {}
        }

        /// The service that replies with the result of a goal when it has ended.
        #[derive(Debug, Clone, Copy)]
        pub struct GetResult;

        impl $crate::msg::Service for GetResult {
            const PACKAGE: &'static str = stringify!($package);
            const NAME: &'static str = concat!(stringify!($action), "_GetResult");
            type Request = GetResultRequest;
            type Response = GetResultResponse;
        }

        $crate::__message! {
            [$package Action concat!(stringify!($action), "_GetResult_Request")]
            ["Selects a goal."]
            GetResultRequest {
                /// Id of the goal.
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
            } {}
        }
        $crate::__message! {
            [$package Action concat!(stringify!($action), "_GetResult_Response")]
            ["Status and result of a goal."]
            GetResultResponse {
                /// Status, a constant of `action_msgs/GoalStatus`.
                status: i8,
                /// Result of the goal.
                result: Outcome,
            } {}
        }
        $crate::__message! {
            [$package Action concat!(stringify!($action), "_FeedbackMessage")]
            ["Feedback with the id of its goal."]
            FeedbackMessage {
                /// Id of the goal.
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

            fn goal_of(r: SendGoalRequest) -> ($crate::msg::unique_identifier_msgs::UUID, Goal) {
                (r.goal_id, r.goal)
            }

            fn goal_response(
                accepted: bool,
                stamp: $crate::msg::builtin_interfaces::Time,
            ) -> SendGoalResponse {
                SendGoalResponse { accepted, stamp }
            }

            fn requested_goal(r: GetResultRequest) -> $crate::msg::unique_identifier_msgs::UUID {
                r.goal_id
            }

            fn result_response(status: i8, result: Outcome) -> GetResultResponse {
                GetResultResponse { status, result }
            }

            fn feedback_message(
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
                feedback: Feedback,
            ) -> FeedbackMessage {
                FeedbackMessage { goal_id, feedback }
            }

            fn goal_request(
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
                goal: Goal,
            ) -> SendGoalRequest {
                SendGoalRequest { goal_id, goal }
            }

            fn is_accepted(r: &SendGoalResponse) -> bool {
                r.accepted
            }

            fn result_request(
                goal_id: $crate::msg::unique_identifier_msgs::UUID,
            ) -> GetResultRequest {
                GetResultRequest { goal_id }
            }

            fn result_of(r: GetResultResponse) -> (i8, Outcome) {
                (r.status, r.result)
            }

            fn feedback_of(
                m: FeedbackMessage,
            ) -> ($crate::msg::unique_identifier_msgs::UUID, Feedback) {
                (m.goal_id, m.feedback)
            }
        }

        /// Every message declared here.
        #[allow(dead_code)]
        pub const DEFINITIONS: &[&$crate::msg::Definition] = &[
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

// Declares one struct with its definition; used by the macros above.
#[doc(hidden)]
#[macro_export]
macro_rules! __message {
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
        #[derive(
            Debug,
            Clone,
            PartialEq,
            $crate::__private::serde::Serialize,
            $crate::__private::serde::Deserialize,
        )]
        // The attribute takes a literal only, so `$crate` is not possible here.
        #[serde(crate = "::fuyu_ros::__private::serde")]
        pub struct $name {
            $($(#[doc = $field_doc])* pub $field: $ty,)*
        }

        impl $name {
            $($(#[doc = $constant_doc])* pub const $constant: $constant_ty = $value;)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    $($field: $crate::__default_value!($($default)?),)*
                }
            }
        }

        impl $crate::__private::ros2_client::Message for $name {}

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
                    name: $crate::__private::ros_name(stringify!($field)),
                    ty: <$ty as $crate::msg::Field>::TYPE,
                    default: $crate::__default_text!($ty $(, $default)?),
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

#[doc(hidden)]
#[macro_export]
macro_rules! __default_value {
    () => {
        Default::default()
    };
    ($default:expr) => {
        $default
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __default_text {
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
