"""Controller with scripted replies; it encodes its packets by itself."""

import contextlib
import selectors
import socket
import struct
import threading

DASHBOARD, SCRIPT, RTDE = 29999, 30003, 30004

FIT_REPLIES = {
    "is in remote control": "true",
    "robotmode": "Robotmode: RUNNING",
    "safetystatus": "Safetystatus: NORMAL",
}


class ScriptedController:
    """Serves the three ports of ``host``; without ``speaks`` it accepts and stays silent."""

    def __init__(self, host, *, version=(5, 11, 1, 108318), ports=(DASHBOARD, SCRIPT, RTDE)):
        self.version = version
        self.replies = dict(FIT_REPLIES)
        self.in_use = set()
        self.unknown = set()
        self.banner = b"Connected: Universal Robots Dashboard Server\n"
        self.chatter = b""  # sent before each RTDE reply
        self.accepts_v2 = True
        self.runtime_states = [1]  # sent in turn, the last one forever
        self.speed_fraction = 1.0
        self.speaks = {DASHBOARD, RTDE}
        self.commands = []
        self._listening = set()
        self._selector = selectors.DefaultSelector()
        for port in ports:
            listener = socket.create_server((host, port))
            self._selector.register(listener, selectors.EVENT_READ, ("listen", port))
        self._stopping = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self):
        self._stopping = True
        self._thread.join()
        for key in list(self._selector.get_map().values()):
            key.fileobj.close()
        self._selector.close()

    def _serve(self):
        while not self._stopping:
            for key, _ in self._selector.select(timeout=0.02):
                kind, port = key.data
                if kind == "listen":
                    self._accept(key.fileobj, port)
                else:
                    self._reply(key.fileobj, port)
            self._send_state()

    def _accept(self, listener, port):
        peer, _ = listener.accept()
        self._selector.register(peer, selectors.EVENT_READ, ("peer", port))
        if port == DASHBOARD and port in self.speaks:
            peer.sendall(self.banner)

    def _reply(self, peer, port):
        try:
            data = peer.recv(65536)
            if data and port in self.speaks:
                peer.sendall(self._line(data) if port == DASHBOARD else self._packet(data))
                if port == RTDE and data[2:3] == b"S":
                    self._listening.add(peer)
        except ConnectionError:
            data = b""
        if not data:
            self._listening.discard(peer)
            self._selector.unregister(peer)
            peer.close()

    def _line(self, data):
        command = data.decode().strip()
        self.commands.append(command)
        fallback = f"could not understand: '{command}'"
        return self.replies.get(command, fallback).encode() + b"\n"

    def _packet(self, data):
        kind, body = data[2:3], data[3:]
        if kind == b"V":
            reply = bytes([self.accepts_v2])
        elif kind == b"v":
            reply = struct.pack(">4I", *self.version)
        elif kind == b"O":
            reply = b"\x01UINT32,DOUBLE"
        elif kind == b"S":
            reply = b"\x01"
        else:
            reply = b"\x01" + ",".join(map(self.type_of, body.decode().split(","))).encode()
        return self.chatter + struct.pack(">Hc", 3 + len(reply), kind) + reply

    def _send_state(self):
        """Send states to every client that has started data packets, as controllers do."""
        for peer in self._listening:
            state = self.runtime_states[0]
            if len(self.runtime_states) > 1:
                del self.runtime_states[0]
            body = struct.pack(">BId", 1, state, self.speed_fraction)
            with contextlib.suppress(ConnectionError):
                peer.sendall(struct.pack(">Hc", 3 + len(body), b"U") + body)

    def type_of(self, name):
        if name in self.in_use:
            return "IN_USE"
        if name in self.unknown:
            return "NOT_FOUND"
        return "INT32" if "_int_" in name else "DOUBLE"
