// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "vfplan/bundle/fixture.hpp"

/// Writes a bundle as `vfplan info --json` does.
class JsonWriter {
  public:
    JsonWriter(std::ostream& out, bool values) : out_(out), values_(values) {}

    void write(const vfplan::bundle::Bundle& bundle) {
        const auto& content = bundle.content;
        out_ << "{";
        for (const char* name : {"format", "version", "frame"}) {
            out_ << string(name) << ": " << string(content.at(std::string("/@") + name).string())
                 << ",\n ";
        }
        out_ << "\"points\": " << content.at("/points").shape[0] << ",\n \"seal\": ";
        write(bundle.seal);
        for (const auto& row : vfplan::bundle::rows) {
            if (!content.has(row.path)) continue;
            out_ << ",\n " << string(row.path) << ": ";
            const bool many = row.shape[0] == "N" || row.shape[0] == "K";
            many ? summary(content.at(row.path)) : plain(content.at(row.path));
        }
        out_ << "}\n";
    }

    static std::string string(std::string_view text) {
        std::string quoted = "\"";
        for (const char c : text) {
            if (c == '"' || c == '\\') quoted += '\\';
            if (static_cast<unsigned char>(c) < 0x20) {
                char code[8];
                std::snprintf(code, sizeof code, "\\u%04x", c);
                quoted += code;
            } else {
                quoted += c;
            }
        }
        return quoted + '"';
    }

  private:
    void write(const vfplan::bundle::Seal& seal) {
        out_ << "{\"ok\": true, \"signed\": " << (seal.is_signed ? "true" : "false")
             << ", \"key_id\": "
             << (seal.is_signed ? string(vfplan::bundle::to_hex(seal.key_id)) : "null")
             << ", \"sha256\": " << string(vfplan::bundle::to_hex(seal.digest));
        if (!seal.case_token.empty()) out_ << ", \"case\": " << string(seal.case_token);
        if (!seal.robot_serial.empty()) out_ << ", \"robot_serial\": " << string(seal.robot_serial);
        if (seal.signed_at != 0) {
            const auto moment = static_cast<std::time_t>(seal.signed_at);
            char text[32];
            std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&moment));
            out_ << ", \"signed_utc\": " << string(text);
        }
        if (seal.despite_findings) out_ << ", \"despite_findings\": true";
        out_ << "}";
    }

    void number(double value) {
        char text[32];
        std::snprintf(text, sizeof text, "%.17g", value);
        out_ << text;
    }
    void number(std::int32_t value) { out_ << value; }
    void number(std::uint8_t value) { out_ << static_cast<int>(value); }

    template <class T>
    void nested(const std::vector<T>& data, const std::vector<std::size_t>& shape) {
        const auto put = [&](const T& item) {
            if constexpr (std::is_same_v<T, std::string>) {
                out_ << string(item);
            } else {
                number(item);
            }
        };
        if (shape.empty()) return put(data.front());
        const std::size_t columns = shape.size() == 2 ? shape[1] : 0;
        for (std::size_t i = 0; i < data.size(); ++i) {
            out_ << (i == 0 ? "[" : ", ");
            if (columns != 0 && i % columns == 0) out_ << "[";
            put(data[i]);
            if (columns != 0 && i % columns == columns - 1) out_ << "]";
        }
        out_ << "]";
    }

    void plain(const vfplan::bundle::Value& value) {
        switch (value.type) {
            case vfplan::bundle::Type::f8:
                return nested(value.f8, value.shape);
            case vfplan::bundle::Type::i4:
                return nested(value.i4, value.shape);
            case vfplan::bundle::Type::u1:
                return nested(value.u1, value.shape);
            default:
                return nested(value.text, value.shape);
        }
    }

    template <class T>
    void range_and_hash(const std::vector<T>& data) {
        const auto [low, high] = std::minmax_element(data.begin(), data.end());
        out_ << ", \"min\": ";
        number(*low);
        out_ << ", \"max\": ";
        number(*high);
        const auto* bytes = reinterpret_cast<const unsigned char*>(data.data());
        const auto digest = vfplan::bundle::sha256({bytes, data.size() * sizeof(T)});
        out_ << ", \"sha256\": " << string(vfplan::bundle::to_hex(digest));
    }

    void summary(const vfplan::bundle::Value& value) {
        out_ << "{\"shape\": [" << value.shape[0];
        if (value.shape.size() == 2) out_ << ", " << value.shape[1];
        out_ << "]";
        if (value.type == vfplan::bundle::Type::f8) range_and_hash(value.f8);
        if (value.type == vfplan::bundle::Type::i4) range_and_hash(value.i4);
        if (value.type == vfplan::bundle::Type::u1) range_and_hash(value.u1);
        if (values_) {
            out_ << ", \"values\": ";
            plain(value);
        }
        out_ << "}";
    }

    std::ostream& out_;
    bool values_;
};
