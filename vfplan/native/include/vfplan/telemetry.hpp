// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a controller shows to the outside: every tick, by UDP, without the loop ever waiting.
//
// `publish` writes into a queue that was allocated before, and returns. Where the queue is full,
// the tick is dropped and counted. A thread of its own empties the queue and sends datagrams of up
// to eleven ticks. The layout stands in docs/live.md. It needs POSIX.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <thread>

#include "vfplan/base/queue.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::inline v1 {

/// A tick as it is sent.
struct TelemetryRecord {
    std::uint64_t index;
    double t;        ///< [s]
    Vec3 values[4];  ///< HIP, proxy, normal, force
    std::int8_t state;
    std::uint8_t status;
    std::uint8_t nothing[6];
};

/// Sends every tick of one loop to one place. One thread publishes, and any thread may ask what was
/// dropped.
class Telemetry {
  public:
    static constexpr std::size_t tick_bytes = 120, header_bytes = 24, most_ticks = 11;

    /// @param address IPv4 address to send to; the loopback unless told
    /// @param port UDP port
    /// @param capacity ticks that the queue holds at least
    /// @param period how often the sender looks into the queue [s]
    /// @throws std::invalid_argument for an address, port or period out of range;
    ///         std::runtime_error where the system gives no socket
    explicit Telemetry(std::uint16_t port, const std::string& address = "127.0.0.1",
                       std::size_t capacity = 4096, double period = 0.005)
        : queue_(capacity), period_(period) {
        static_assert(std::endian::native == std::endian::little, "the layout is little-endian");
        if (port == 0) reject("telemetry: port 0: 1 to 65535 is wanted");
        if (!(period > 0 && period <= 1))
            reject("telemetry: period " + std::to_string(period) +
                   " s: above 0 and at most 1 is wanted");
        to_.sin_family = AF_INET;
        to_.sin_port = htons(port);
        if (inet_pton(AF_INET, address.c_str(), &to_.sin_addr) != 1)
            reject("telemetry: '" + address + "' is no IPv4 address");
        socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        if (socket_ < 0) reject<std::runtime_error>("telemetry: the system gives no socket");
        sender_ = std::thread([this] { send_all(); });
    }
    ~Telemetry() {
        stop_.store(true, std::memory_order_release);
        sender_.join();
        ::close(socket_);
    }

    /// Takes a tick in; false where the queue was full and the tick was dropped. It never waits.
    /// @param t time of the tick [s]
    /// @param hip where the tool is [m]
    /// @param step what the engine answered
    bool publish(double t, const Vec3& hip, const Step& step) noexcept {
        const TelemetryRecord tick{
            index_++,    t, {hip, step.proxy, step.normal, step.force}, std::int8_t(step.state),
            step.status, {}};
        if (queue_.push(tick)) return true;
        dropped_.fetch_add(1, std::memory_order_relaxed);
        return false;
    }

    /// Number of ticks that found the queue full.
    std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }
    /// Number of datagrams that the system did not take.
    std::uint64_t unsent() const noexcept { return unsent_.load(std::memory_order_relaxed); }

  private:
    /// Of a datagram.
    struct Header {
        char magic[4];
        std::uint16_t version, ticks;
        std::uint64_t datagram, dropped;
    };
    static_assert(sizeof(TelemetryRecord) == tick_bytes && sizeof(Header) == header_bytes);

    void send_all() noexcept {
        for (;;) {
            const bool last = stop_.load(std::memory_order_acquire);
            while (queue_.front()) send_some();
            if (last) return;
            std::this_thread::sleep_for(std::chrono::duration<double>(period_));
        }
    }
    void send_some() noexcept {
        std::array<char, header_bytes + most_ticks * tick_bytes> bytes{};
        std::uint16_t count = 0;
        for (; count < most_ticks && queue_.front(); ++count, queue_.pop())
            std::memcpy(bytes.data() + header_bytes + count * tick_bytes, queue_.front(),
                        tick_bytes);
        const Header header{{'V', 'F', 'P', 'T'}, 1, count, sent_, dropped()};
        std::memcpy(bytes.data(), &header, header_bytes);
        const std::size_t size = header_bytes + count * tick_bytes;
        const auto* to = reinterpret_cast<const sockaddr*>(&to_);
        if (::sendto(socket_, bytes.data(), size, MSG_NOSIGNAL, to, sizeof to_) != ssize_t(size))
            unsent_.fetch_add(1, std::memory_order_relaxed);
        ++sent_;
    }

    SpscQueue<TelemetryRecord> queue_;
    double period_;
    sockaddr_in to_{};
    int socket_ = -1;
    std::uint64_t index_ = 0;  // of the publisher
    std::uint64_t sent_ = 0;   // of the sender
    alignas(64) std::atomic<std::uint64_t> dropped_{0};
    std::atomic<std::uint64_t> unsent_{0};
    std::atomic<bool> stop_{false};
    std::thread sender_;
};

}  // namespace vfplan::inline v1
