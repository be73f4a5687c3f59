"""A small RTSP server on loopback: JPEGs over RTP (RFC 2435), interleaved in the TCP connection."""

import contextlib
import socket
import struct
import threading

_PAYLOAD_BYTES = 1400
_CLOCK_HZ = 90_000
_FRAME_S = 0.04


class RtspServer:
    def __init__(self, jpegs):
        self._frames = [_parts(jpeg) for jpeg in jpegs]
        self._over = threading.Event()
        self._socket = socket.create_server(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self.port = self._socket.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept)]

    def __enter__(self):
        self._threads[0].start()
        return self

    def __exit__(self, *_):
        self._over.set()
        for thread in self._threads:
            thread.join()
        self._socket.close()

    def _accept(self):
        while not self._over.is_set():
            with contextlib.suppress(TimeoutError):
                client, _ = self._socket.accept()
                thread = threading.Thread(target=self._talk, args=(client,))
                self._threads.append(thread)
                thread.start()

    def _talk(self, client):
        with client, contextlib.suppress(OSError):
            client.settimeout(20.0)
            head = b""
            while not self._over.is_set():
                data = client.recv(4096)
                if not data:
                    return
                head += data
                while b"\r\n\r\n" in head:
                    request, _, head = head.partition(b"\r\n\r\n")
                    lines = request.decode().split("\r\n")
                    fields = dict(line.split(": ", 1) for line in lines[1:] if ": " in line)
                    method, url, _ = lines[0].split(" ")
                    client.sendall(self._answer(method, url, fields["CSeq"]))
                    if method == "PLAY":
                        self._play(client)
                        return

    def _answer(self, method, url, number):
        body, more = "", ""
        if method == "OPTIONS":
            more = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = (
                "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=test\r\nt=0 0\r\n"
                f"m=video 0 RTP/AVP 26\r\na=control:{url}/track\r\n"
            )
            more = f"Content-Base: {url}/\r\nContent-Type: application/sdp\r\n"
            more += f"Content-Length: {len(body)}\r\n"
        elif method == "SETUP":
            more = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        elif method == "PLAY":
            more = "Session: 1\r\nRange: npt=0.0-\r\n"
        return f"RTSP/1.0 200 OK\r\nCSeq: {number}\r\n{more}\r\n{body}".encode()

    def _play(self, client):
        sequence = count = 0
        while not self._over.wait(_FRAME_S):
            head, tables, scan = self._frames[count % len(self._frames)]
            stamp = round(count * _FRAME_S * _CLOCK_HZ)
            count += 1
            for offset in range(0, len(scan), _PAYLOAD_BYTES):
                part = scan[offset : offset + _PAYLOAD_BYTES]
                last = offset + len(part) == len(scan)
                rtp = struct.pack(">BBHII", 0x80, 26 | last << 7, sequence & 0xFFFF, stamp, 1)
                # RFC 2435: offset, type, quality 255 (the tables come along), size in eights
                jpeg = struct.pack(">I", offset) + head
                if offset == 0:
                    jpeg += struct.pack(">BBH", 0, 0, len(tables)) + tables
                packet = rtp + jpeg + part
                client.sendall(b"$\0" + struct.pack(">H", len(packet)) + packet)
                sequence += 1


def _parts(jpeg):
    """Return the parts of a baseline JPEG that RFC 2435 sends: short head, tables and scan."""
    at, tables, kind, size = 2, b"", 1, (0, 0)
    while True:
        marker, (length,) = jpeg[at + 1], struct.unpack_from(">H", jpeg, at + 2)
        segment = jpeg[at + 4 : at + 2 + length]
        if marker == 0xDB:
            while segment:
                tables += segment[1:65]
                segment = segment[65:]
        elif marker == 0xC0:
            height, width = struct.unpack_from(">HH", segment, 1)
            size = (width // 8, height // 8)
            kind = {0x21: 0, 0x22: 1}[segment[7]]  # 4:2:2 or 4:2:0
        at += 2 + length
        if marker == 0xDA:
            break
    return bytes([kind, 255, *size]), tables, jpeg[at:-2]
