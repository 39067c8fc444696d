//! Runs the nodes of one process: starts them, keeps them connected, stops them in order.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    process::ExitCode,
    sync::{
        Arc,
        mpsc::{self, RecvTimeoutError},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use super::{
    DiscoveryRange, Domain, Node, NodeError, NodeOptions, Qos, RosArgs,
    allocator::return_free_memory,
    descriptor_limit,
    diagnostics::Reporter,
    endpoint::EndpointSpec,
    help, logging,
    names::Names,
    node_core::{NodeCore, Place},
    params::{self, ParameterStore, USE_SIM_TIME},
    participant::Participants,
    service::ServiceServer,
    signals::{self, ProcessSignal, StopRequest, StopRequests},
    transport::Middleware,
    wall_clock_watch::WallClockWatch,
};
use crate::msg::{diagnostic_msgs::DiagnosticArray, rcl_interfaces::Log};

/// How often a node reports its health.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);
/// Period at which a process checks for a wall clock that was set back, and checks its connection to the graph.
const CHECK_PERIOD: Duration = Duration::from_secs(1);
/// Longest time that a node may take to end after a stop request.
const STOP_PATIENCE: Duration = Duration::from_secs(10);

/// Runs one node as a process of its own: the main function of a node's executable, with the arguments and environment
/// variables of ROS. Returns after SIGINT or SIGTERM, or when the program ends.
pub fn run(
    name: &str,
    program: impl FnOnce(&Node) -> Result<(), NodeError> + Send + 'static,
) -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let Some(text) = help::requested(name, &args) {
        print!("{text}");
        return ExitCode::SUCCESS;
    }
    return_free_memory();
    let outcome =
        Process::from_env(args, DiscoveryRange::Subnet).and_then(|(mut process, rest)| {
            if let Some(unknown) = rest.first() {
                return Err(NodeError::Input(format!(
                    "argument {unknown:?}: not known; ROS arguments follow --ros-args"
                )));
            }
            Arc::make_mut(&mut process.args).only_node = true;
            process.start(name, program)?;
            process.wait()
        });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(e.exit_code())
        }
    }
}

enum Event {
    /// The program of a node has ended.
    Ended(usize, Result<(), NodeError>),
    /// The process should stop.
    Stop,
}

/// Handle that stops a process, from any thread.
#[derive(Clone)]
pub struct Stopper(mpsc::Sender<Event>);

impl Stopper {
    /// Requests the stop.
    pub fn stop(&self) {
        // If the process no longer exists, there is nothing to stop.
        let _ = self.0.send(Event::Stop);
    }
}

/// Several nodes in one process, each with its own threads. They share a DDS participant, unless they are
/// [`isolated`](Self::isolated).
///
/// When one node ends, the others are stopped in the reverse order of their start.
pub struct Process {
    args: Arc<RosArgs>,
    domain: Domain,
    isolated: bool,
    nodes: Vec<Running>,
    participants: Arc<Participants>,
    sender: mpsc::Sender<Event>,
    events: mpsc::Receiver<Event>,
    /// First failure of a node.
    failure: Option<NodeError>,
    stopping: bool,
    wall_clock: WallClockWatch,
    /// Time of the last check of the connection.
    checked: Instant,
}

impl Process {
    /// Creates the process in a main function: blocks signals in this thread and all later ones, removes the ROS
    /// arguments from `argv`, starts the log, raises the limit of open files as far as possible, reads the environment,
    /// and handles SIGINT, SIGTERM and SIGCONT. Must be called before any other thread is started. Also returns the
    /// remaining arguments.
    ///
    /// # Errors
    /// [`NodeError::Args`] and [`NodeError::Domain`] for wrong input.
    pub fn from_env(
        argv: impl IntoIterator<Item = String>,
        reach: DiscoveryRange,
    ) -> Result<(Self, Vec<String>), NodeError> {
        signals::block();
        let (args, rest) = RosArgs::parse(argv)?;
        logging::init(&args);
        descriptor_limit::raise();
        let domain = Domain::from_env(reach)?;
        let mut process = Self::new(args, domain);
        process.participants = Arc::new(Participants::new(Middleware::from_env()?));
        process.follow_signals()?;
        Ok((process, rest))
    }

    /// Creates a process within a larger program, which handles signals and log itself.
    pub fn new(args: RosArgs, domain: Domain) -> Self {
        let (sender, events) = mpsc::channel();
        Self {
            args: Arc::new(args),
            domain,
            isolated: false,
            nodes: Vec::new(),
            participants: Arc::default(),
            sender,
            events,
            failure: None,
            stopping: false,
            wall_clock: WallClockWatch::new(),
            checked: Instant::now(),
        }
    }

    /// Sets the middleware for nodes started from now on; the default is DDS without static peers.
    #[must_use]
    pub fn with_middleware(mut self, middleware: Middleware) -> Self {
        self.participants = Arc::new(Participants::new(middleware));
        self
    }

    /// Gives every node started from now on a participant of its own, so that nodes of the process communicate over
    /// DDS.
    #[must_use]
    pub fn isolated(mut self) -> Self {
        self.isolated = true;
        self
    }

    /// Replaces the ROS arguments for nodes started from now on.
    pub fn set_args(&mut self, args: RosArgs) {
        self.args = Arc::new(args);
    }

    /// The arguments.
    pub fn args(&self) -> &RosArgs {
        &self.args
    }

    /// DDS domain of the nodes.
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// A handle that stops this process, from any thread.
    pub fn stopper(&self) -> Stopper {
        Stopper(self.sender.clone())
    }

    fn follow_signals(&self) -> Result<(), NodeError> {
        let stopper = self.stopper();
        let participants = Arc::clone(&self.participants);
        let mut stops = StopRequests::default();
        // Nodes do not reconnect after a stop request: systemd and `timeout` send SIGTERM and SIGCONT.
        signals::watch(move |signal_kind| match signal_kind {
            ProcessSignal::Stop(signal) => match stops.add(Instant::now()) {
                StopRequest::First => {
                    tracing::info!("{signal}: stopping");
                    stopper.stop();
                }
                StopRequest::Same => {}
                StopRequest::Again => {
                    tracing::warn!("{signal} again: ending at once");
                    std::process::exit(128 + signal as i32);
                }
            },
            ProcessSignal::Continued if !stops.is_stopping() => {
                participants.reconnect_after_interruption("continued after a stop");
            }
            ProcessSignal::Continued => {}
        })
        .map_err(|e| NodeError::Failed(format!("cannot follow signals: {e}")))
    }

    /// Starts a node with the name `name`, which arguments may remap.
    ///
    /// # Errors
    /// [`NodeError`] for arguments and files that are wrong for this node, or if DDS refuses.
    pub fn start(
        &mut self,
        name: &str,
        program: impl FnOnce(&Node) -> Result<(), NodeError> + Send + 'static,
    ) -> Result<Node, NodeError> {
        let options = NodeOptions {
            name: name.to_owned(),
            namespace: "/".to_owned(),
            args: Arc::clone(&self.args),
            domain: self.domain,
            parameter_services: true,
        };
        self.start_with(options, program)
    }

    /// Starts a node with its own options.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_with(
        &mut self,
        options: NodeOptions,
        program: impl FnOnce(&Node) -> Result<(), NodeError> + Send + 'static,
    ) -> Result<Node, NodeError> {
        let index = self.nodes.len();
        let infrastructure = Infrastructure::new(&options, &self.participants, self.isolated)?;
        let node = infrastructure.node.clone();
        let ended = self.sender.clone();
        let handle = node.clone();
        let program = move || {
            logging::enter(&handle.core);
            let outcome = catch_unwind(AssertUnwindSafe(|| program(&handle)));
            let outcome = outcome.unwrap_or_else(|_| {
                let text = format!("node {}: program panicked", handle.name());
                Err(NodeError::Failed(text))
            });
            // The program of a node that was stopped because of a failure returns no error itself.
            let outcome = match handle.core.stop_state.failure() {
                Some(reason) => Err(NodeError::Failed(reason.clone())),
                None => outcome,
            };
            drop(handle);
            // The process may no longer wait for the node.
            let _ = ended.send(Event::Ended(index, outcome));
        };
        let thread = thread::Builder::new()
            .name(node.name().name().to_owned())
            .spawn(program)
            .map_err(|e| NodeError::Failed(format!("node {}: no thread: {e}", node.name())))?;
        self.nodes.push(Running {
            infrastructure,
            thread,
            ended: false,
        });
        Ok(node)
    }

    /// Runs the nodes for `patience`. Returns false as soon as there is a reason to stop: a signal, a [`Stopper`], or a
    /// node that has ended.
    pub fn run_for(&mut self, patience: Duration) -> bool {
        let deadline = Instant::now() + patience;
        while !self.stopping {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.events.recv_timeout(left.min(CHECK_PERIOD)) {
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => self.check_connection(),
                Err(RecvTimeoutError::Disconnected) => return false,
            }
            if !self.stopping && Instant::now() >= deadline {
                return true;
            }
        }
        false
    }

    /// Repairs the connection to the graph, once a second.
    fn check_connection(&mut self) {
        if self.checked.elapsed() >= CHECK_PERIOD {
            self.checked = Instant::now();
            self.check_wall_clock();
            self.participants.connect_again();
            self.participants.reconnect_after_loss();
        }
    }

    /// Replaces the participants if the wall clock was set back: best-effort subscriptions of the old ones would
    /// receive nothing.
    fn check_wall_clock(&mut self) {
        let Some(step) = self.wall_clock.set_back() else {
            return;
        };
        let reason = format!("the wall clock was set back by {:.1} s", step.as_secs_f64());
        for running in &self.nodes {
            let status = running
                .infrastructure
                .node
                .diagnostics()
                .status("wall clock");
            status.warn(format!("{reason}; the node joined the graph again"));
            // The next report still contains the worst level since the previous one.
            status.ok(reason.as_str());
        }
        self.participants.reconnect_after_interruption(&reason);
    }

    /// Runs until there is a reason to stop, then stops all nodes in order.
    ///
    /// # Errors
    /// The first failure of a node.
    pub fn wait(mut self) -> Result<(), NodeError> {
        while self.run_for(Duration::from_secs(3600)) {}
        self.finish()
    }

    /// Stops all nodes in the reverse order of their start, waiting for each to end before the next.
    ///
    /// # Errors
    /// The first failure of a node.
    pub fn finish(mut self) -> Result<(), NodeError> {
        for index in (0..self.nodes.len()).rev() {
            self.stop_node(index);
        }
        self.failure.take().map_or(Ok(()), Err)
    }

    fn take(&mut self, event: Event) {
        self.stopping = true;
        let Event::Ended(index, outcome) = event else {
            return;
        };
        self.nodes[index].ended = true;
        match (outcome, &self.failure) {
            (Ok(()), _) => {}
            (Err(e), None) => self.failure = Some(e),
            // The first failure is the one to report at the end.
            (Err(e), Some(_)) => tracing::error!("{e}"),
        }
    }

    fn stop_node(&mut self, index: usize) {
        let name = self.nodes[index].infrastructure.node.name().clone();
        self.nodes[index].infrastructure.node.request_stop();
        let deadline = Instant::now() + STOP_PATIENCE;
        while !self.nodes[index].ended {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.events.recv_timeout(left) {
                Ok(event) => self.take(event),
                Err(_) => {
                    tracing::error!(
                        "node {name} did not stop within {STOP_PATIENCE:?} and is abandoned"
                    );
                    let text = format!("node {name}: did not stop within {STOP_PATIENCE:?}");
                    self.failure.get_or_insert(NodeError::Failed(text));
                    return;
                }
            }
        }
        let thread = &self.nodes[index].thread;
        while !thread.is_finished() && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(1));
        }
        self.nodes[index].infrastructure.close();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        for node in self.nodes.iter_mut().rev() {
            node.infrastructure.close();
        }
    }
}

struct Running {
    infrastructure: Infrastructure,
    thread: JoinHandle<()>,
    ended: bool,
}

/// Infrastructure of a node, all but its program: receiving and sending thread, parameter services, clock, diagnostics,
/// log.
struct Infrastructure {
    node: Node,
    services: Vec<ServiceServer>,
    receiver: Option<JoinHandle<()>>,
    sender: Option<JoinHandle<()>>,
}

impl Infrastructure {
    fn new(
        options: &NodeOptions,
        participants: &Participants,
        isolated: bool,
    ) -> Result<Self, NodeError> {
        let names = Names::new(&options.namespace, &options.name, &options.args.remaps)?;
        let overrides = options.args.overrides(names.node(), &options.name)?;
        let params = Arc::new(ParameterStore::new(names.node().clone(), overrides));
        let place = Place {
            domain: options.domain,
            isolated,
            only_node: options.args.only_node,
        };
        let core = Arc::new(NodeCore::new(names, params, participants, place)?);
        let node = Node {
            core: Arc::clone(&core),
        };
        let mut parts = Self {
            receiver: Some(start_receiving(&core)?),
            services: Vec::new(),
            sender: None,
            node,
        };
        if options.parameter_services {
            parts.services = params::serve(&parts.node)?;
        }
        // Declared last, so that the declarations of all parameters are announced.
        let simulated = parts
            .node
            .declare()
            .param(USE_SIM_TIME, false, "Take the time from /clock")
            .value();
        if simulated {
            core.use_sim_time(true)?;
        }
        if options.args.rosout {
            let log = EndpointSpec::topic::<Log>("/rosout", Qos::ROSOUT).shared();
            core.set_log(core.add_writer(log)?);
        }
        parts.sender = Some(start_sending(&core)?);
        Ok(parts)
    }

    /// Sends the waiting messages, then leaves the graph.
    fn close(&mut self) {
        let core = &self.node.core;
        if let Some(sender) = self.sender.take() {
            core.send_queue.close();
            let _ = sender.join();
        }
        if let Some(receiver) = self.receiver.take() {
            self.services.clear();
            core.leave();
            core.handlers.close();
            let _ = receiver.join();
        }
    }
}

impl Drop for Infrastructure {
    /// A node whose start has failed leaves the graph as well.
    fn drop(&mut self) {
        self.close();
    }
}

fn thread_error(core: &NodeCore, e: &std::io::Error) -> NodeError {
    NodeError::Failed(format!("node {}: no thread: {e}", core.name))
}

/// Starts the thread that runs the node's handlers.
fn start_receiving(core: &Arc<NodeCore>) -> Result<JoinHandle<()>, NodeError> {
    let receiving = Arc::clone(core);
    thread::Builder::new()
        .name(format!("{}.receive", core.name.name()))
        .spawn(move || {
            logging::enter(&receiving);
            let handlers = &receiving.handlers;
            let participant = &receiving.participant;
            let run =
                || handlers.run(|r, publisher, n| participant.report_invalid(r, publisher, n));
            // A node that cannot receive must not continue to run.
            if catch_unwind(AssertUnwindSafe(run)).is_err() {
                handlers.abandon();
                let reason = format!("node {}: a handler has panicked", receiving.name);
                receiving.stop_state.fail(reason);
            }
        })
        .map_err(|e| thread_error(core, &e))
}

/// Starts the thread that sends the node's messages and reports its health.
fn start_sending(core: &Arc<NodeCore>) -> Result<JoinHandle<()>, NodeError> {
    let topic = core.names.topic("diagnostics")?;
    let reports = EndpointSpec::topic::<DiagnosticArray>(&topic, Qos::RELIABLE);
    let reports = core.add_writer(reports)?;
    let mut reporter = Reporter::new();
    let sending = Arc::clone(core);
    thread::Builder::new()
        .name(format!("{}.send", core.name.name()))
        .spawn(move || {
            logging::enter(&sending);
            sending.send_queue.run(DIAGNOSTICS_PERIOD, || {
                let now = sending.clock.now();
                let report = {
                    let endpoints = sending.participant.endpoints();
                    let own = endpoints.writers.iter();
                    let own = own.filter(|w| Arc::ptr_eq(&w.node, &sending.name));
                    own.for_each(|w| w.held.expire());
                    reporter.report(&sending.name, now, &sending.diagnostics, &endpoints)
                };
                sending.publish(&reports, &report);
            });
        })
        .map_err(|e| thread_error(core, &e))
}
