// The connection to fuyu's Foxglove server: topics, services, parameters and meshes, by the client of Foxglove.

import { parse } from "@foxglove/rosmsg";
import { MessageReader, MessageWriter } from "@foxglove/rosmsg2-serialization";
import { FoxgloveClient, type Channel, type IWebSocket, type Parameter, type Service } from "@foxglove/ws-protocol";

/** The subprotocol that today's servers of Foxglove's SDK accept. */
const SUBPROTOCOL = "foxglove.sdk.v1";
/** How long the page waits before it connects again [ms]. */
const RECONNECT = 1000;
/** How long a call may take before the network counts as stalled [ms]. */
export const STALLED = 500;

/** A decoded message: its fields are those of its ROS definition, which the server states. */
export type Message = any;
type Handler = (message: Message, topic: string) => void;
type Wish = { match: (channel: Channel) => boolean; handler: Handler };
type Reply = { resolve: (data: DataView) => void; reject: (error: Error) => void };

/** A channel with its reader, made when its first message arrives. */
type Subscribed = { channel: Channel; handlers: Handler[]; reader?: MessageReader };

export type State = "connecting" | "watching" | "may operate";

export class Connection {
  state: State = "connecting";
  /** Why the last attempt failed, or what the server warns of. */
  onNotice: (text: string) => void = () => {};
  onState: (state: State) => void = () => {};
  onTime: (nanoseconds: bigint) => void = () => {};
  onServices: () => void = () => {};
  onParameters: (parameters: Parameter[]) => void = () => {};
  /** Connections are numbered, so that what belongs to an earlier one can be recognized. */
  session = 0;
  readonly channels = new Map<number, Channel>();
  readonly services = new Map<string, Service>();
  private client?: FoxgloveClient;
  private socket?: WebSocket;
  private readonly wishes: Wish[] = [];
  private readonly subscriptions = new Map<number, Subscribed>();
  private readonly calls = new Map<number, Reply>();
  private readonly assets = new Map<number, Reply>();
  private readonly requests = new Map<string, (parameters: Parameter[]) => void>();
  private readonly published = new Map<string, { id: number; writer: MessageWriter }>();
  private counter = 1;

  constructor(readonly url: string) {}

  open(): void {
    this.session += 1;
    const socket = new WebSocket(this.url, [SUBPROTOCOL]);
    // The types of its buffers are older than those of the browser.
    const client = new FoxgloveClient({ ws: socket as unknown as IWebSocket });
    this.socket = socket;
    this.client = client;
    let opened = false;
    client.on("open", () => (opened = true));
    client.on("error", () => {});
    client.on("close", () => {
      if (this.client === client) this.lost(opened);
    });
    client.on("serverInfo", (info) => {
      const may = info.capabilities.includes("clientPublish");
      this.setState(may ? "may operate" : "watching");
    });
    client.on("status", (status) => this.onNotice(status.message));
    client.on("time", (time) => this.onTime(time.timestamp));
    client.on("advertise", (channels) => {
      for (const channel of channels) this.channels.set(channel.id, channel);
      // A new topic may take the place of another one.
      for (const channel of this.channels.values()) this.subscribe(channel);
    });
    client.on("unadvertise", (ids) => ids.forEach((id) => this.channels.delete(id)));
    client.on("unadvertiseServices", (ids) => {
      for (const [name, service] of this.services) if (ids.includes(service.id)) this.services.delete(name);
      this.onServices();
    });
    client.on("advertiseServices", (services) => {
      for (const service of services) this.services.set(service.name, service);
      this.onServices();
    });
    client.on("message", ({ subscriptionId, data }) => this.take(subscriptionId, data));
    client.on("serviceCallResponse", ({ callId, data }) => this.answer(this.calls, callId)?.resolve(view(data)));
    client.on("serviceCallFailure", ({ callId, message }) =>
      this.answer(this.calls, callId)?.reject(new Error(message)),
    );
    client.on("fetchAssetResponse", (response) => {
      const reply = this.answer(this.assets, response.requestId);
      if ("data" in response) reply?.resolve(view(response.data));
      else reply?.reject(new Error(response.error));
    });
    client.on("parameterValues", ({ parameters, id }) => {
      const asked = id === undefined ? undefined : this.requests.get(id);
      if (id !== undefined) this.requests.delete(id);
      asked?.(parameters);
      this.onParameters(parameters);
    });
  }

  /** Calls `handler` for messages of the topics that `match` accepts, now or later. */
  on(match: (channel: Channel) => boolean, handler: Handler): void {
    this.wishes.push({ match, handler });
    for (const channel of this.channels.values()) this.subscribe(channel);
  }

  onTopic(topic: string, handler: Handler): void {
    this.on((channel) => channel.topic === topic, handler);
  }

  private subscribe(channel: Channel): void {
    const handlers = this.wishes.filter(({ match }) => match(channel)).map(({ handler }) => handler);
    const known = [...this.subscriptions].find(([, s]) => s.channel.id === channel.id);
    if (known && handlers.length === 0) {
      this.client?.unsubscribe(known[0]);
      this.subscriptions.delete(known[0]);
    } else if (known) known[1].handlers = handlers;
    else if (handlers.length > 0 && channel.encoding === "cdr" && this.client) {
      this.subscriptions.set(this.client.subscribe(channel.id), { channel, handlers });
    }
  }

  private take(subscription: number, data: ArrayBufferView): void {
    const found = this.subscriptions.get(subscription);
    if (!found) return;
    try {
      found.reader ??= new MessageReader(parse(found.channel.schema, { ros2: true }));
      const message = found.reader.readMessage(data);
      for (const handler of found.handlers) handler(message, found.channel.topic);
    } catch (error) {
      // One topic that cannot be read must not end the others.
      this.onNotice(`${found.channel.topic}: ${String(error)}`);
    }
  }

  /** Publishes on `topic`; the definition is that of the type, with those of the types that it contains. */
  publish(topic: string, schemaName: string, definition: string, message: Message): void {
    if (!this.client || this.state !== "may operate") return;
    let known = this.published.get(topic);
    if (!known) {
      const id = this.client.advertise({ topic, schemaName, encoding: "cdr", schema: definition, schemaEncoding: "ros2msg" });
      known = { id, writer: new MessageWriter(parse(definition, { ros2: true })) };
      this.published.set(topic, known);
    }
    this.client.sendMessage(known.id, known.writer.writeMessage(message));
  }

  /** Whether what is sent leaves: a stalled network fills the browser's buffer. */
  get congested(): boolean {
    return (this.socket?.bufferedAmount ?? 0) > 64 * 1024;
  }

  /** Calls a service. Fails when the server refuses, does not know it, or the connection is lost. */
  async call(name: string, request: Message): Promise<Message> {
    const service = this.services.get(name);
    if (!service?.request || !service.response || !this.client) throw new Error(`${name} is not offered`);
    const writer = new MessageWriter(parse(service.request.schema, { ros2: true }));
    const reader = new MessageReader(parse(service.response.schema, { ros2: true }));
    const callId = this.counter++;
    const data = await new Promise<DataView>((resolve, reject) => {
      this.calls.set(callId, { resolve, reject });
      this.client?.sendServiceCallRequest({ serviceId: service.id, callId, encoding: "cdr", data: writer.writeMessage(request) });
    });
    return reader.readMessage(data);
  }

  async fetchAsset(name: string): Promise<DataView> {
    const client = this.client;
    if (!client || this.state === "connecting") throw new Error("not connected");
    const id = this.counter++;
    return new Promise((resolve, reject) => {
      this.assets.set(id, { resolve, reject });
      client.fetchAsset(name, id);
    });
  }

  /** Values of parameters (`/NODE.NAME`); of all without names. */
  getParameters(names: string[]): Promise<Parameter[]> {
    return this.ask((id) => this.client?.getParameters(names, id));
  }

  /** Sets parameters; what they are then. */
  setParameters(parameters: Parameter[]): Promise<Parameter[]> {
    return this.ask((id) => this.client?.setParameters(parameters, id));
  }

  watchParameters(names: string[]): void {
    this.client?.subscribeParameterUpdates(names);
  }

  private ask(send: (id: string) => void): Promise<Parameter[]> {
    if (this.state !== "may operate") return Promise.resolve([]);
    const id = `request ${this.counter++}`;
    return new Promise((resolve) => {
      this.requests.set(id, resolve);
      send(id);
    });
  }

  private answer(waiting: Map<number, Reply>, id: number): Reply | undefined {
    const reply = waiting.get(id);
    waiting.delete(id);
    return reply;
  }

  private lost(opened: boolean): void {
    this.client = undefined;
    this.channels.clear();
    this.services.clear();
    this.subscriptions.clear();
    this.published.clear();
    for (const waiting of [this.calls, this.assets]) {
      const replies = [...waiting.values()];
      waiting.clear();
      for (const reply of replies) reply.reject(new Error("the connection is lost"));
    }
    for (const resolve of this.requests.values()) resolve([]);
    this.requests.clear();
    this.setState("connecting");
    this.onNotice(
      opened
        ? "The connection is lost; connecting again."
        : "No connection: is fuyu launch --cockpit running? A page from another origin is refused.",
    );
    setTimeout(() => this.open(), RECONNECT);
  }

  private setState(state: State): void {
    this.state = state;
    this.onState(state);
  }
}

function view(data: ArrayBufferView): DataView {
  return new DataView(data.buffer, data.byteOffset, data.byteLength);
}
