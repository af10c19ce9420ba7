// A small board for SonicSurface's wire: 16 to 256 channels, 32 steps of a 40 kHz period, no reply.
//
// FEh begins a frame, 256 codes follow (0 to 31: step of the rising edge, 32: off) of which the first
// CHANNELS count, FDh swaps the two buffers. 96h stops the pins, 97h lets them go on. C1h selects
// another board, C0h this one. Two chained shift registers make 16 pins of each line of DATA, with
// one SHIFT and LATCH. A pin is high for 16 steps.
//
// The clock has 32 MHz: 25 clocks a step, 800 a period of 40 kHz.
module board #(
    parameter CHANNELS = 16,     // a multiple of 16, up to 256
    parameter BIT = 139,         // clocks of a bit at 230400 baud
    // Defects, each off at 0.
    parameter LATE_BIT = 0,      // 1: the last bit comes behind the latch, channel 15 of 16 a step late
    parameter STAGGER = 0,       // clocks by which channels 8 to 15 of 16 latch after the others, up to 7
    parameter WRONG_BUFFER = 0,  // 1: codes go to the buffer that is shown
    parameter HALF_CARRIER = 0,  // 1: 20 kHz
    parameter TORN = 0           // periods by which channels 8 to 15 of 16 swap after the others
) (
    input clk,
    input rx,
    output reg [CHANNELS/16-1:0] data,
    output reg shift,
    output latch,
    output latch_above,
    output [CHANNELS-1:0] pins
);
    // --- UART: 8N1, sampled in the middle of each bit ---------------------------------------------
    reg [1:0] line = 3;
    reg [15:0] wait_clocks = 0;
    reg [3:0] bits = 0;       // that are still to come; the stop bit is the last
    reg [7:0] byte_in = 0;
    reg received = 0;
    always @(posedge clk) begin
        line <= {line[0], rx};
        received <= 0;
        if (bits == 0) begin
            if (!line[1]) begin
                bits <= 9;
                wait_clocks <= BIT[15:0] + BIT[15:0] / 2 - 2;
            end
        end else if (wait_clocks != 0) begin
            wait_clocks <= wait_clocks - 1;
        end else begin
            wait_clocks <= BIT[15:0] - 1;
            bits <= bits - 1;
            if (bits == 1) received <= line[1];  // without a stop bit it is no byte
            else byte_in <= {line[1], byte_in[7:1]};
        end
    end

    // --- Clocks of a step, steps of a period -------------------------------------------------------
    reg [4:0] clocks = 0;     // of this step
    reg [5:0] step = 0;
    wire step_ends = clocks == 24;
    wire period_ends = step_ends && step == (HALF_CARRIER != 0 ? 63 : 31);
    always @(posedge clk) begin
        clocks <= step_ends ? 0 : clocks + 1;
        if (step_ends) step <= period_ends ? 0 : step + 1;
    end

    // --- Two buffers of codes ---------------------------------------------------------------------
    reg [5:0] codes [0:511];  // buffer 0, then buffer 1
    reg [7:0] channel = 0;    // that the next code is for
    reg listens = 1;
    reg clocked = 1;
    reg shown = 0;            // buffer of channels 0 to 7 of 16
    reg shown_above = 0;      // and of channels 8 to 15
    reg [15:0] torn = 0;
    integer n;
    initial for (n = 0; n < 512; n = n + 1) codes[n] = 0;

    wire written = WRONG_BUFFER != 0 ? shown : !shown;
    always @(posedge clk) begin
        if (torn == 0) shown_above <= shown;
        else if (period_ends) torn <= torn - 1;
        if (received) case (byte_in)
            8'hFE: if (listens) channel <= 0;
            8'hFD: begin
                channel <= 0;
                shown <= !shown;
                torn <= TORN[15:0];
            end
            8'h96: clocked <= 0;
            8'h97: clocked <= 1;
            8'hC0: listens <= 1;
            8'hC1: listens <= 0;
            default: if (listens) begin
                codes[{written, channel}] <= {byte_in == 32, byte_in[4:0]};
                channel <= channel + 1;
            end
        endcase
    end

    // --- A bit of each channel in a step, then the latch -----------------------------------------
    // The first bit goes furthest: channel 15. If the last bit is late, that is channel 15 as well.
    wire [3:0] of_channel = (LATE_BIT != 0 ? 4'd14 : 4'd15) - clocks[3:0];
    wire buffer = of_channel[3] ? shown_above : shown;
    wire [5:0] now = HALF_CARRIER != 0 ? step >> 1 : step;
    reg [7:0] latches = 0;
    initial shift = 0;
    always @(posedge clk) begin
        shift <= clocked && clocks < 16;
        latches <= {latches[6:0], clocked && clocks == (LATE_BIT != 0 ? 15 : 16)};
    end
    assign latch = latches[0];
    assign latch_above = latches[STAGGER];

    genvar line_of;
    generate for (line_of = 0; line_of < CHANNELS / 16; line_of = line_of + 1) begin : chain
        localparam [3:0] HERE = line_of;
        wire [5:0] code = codes[{buffer, HERE, of_channel}];
        wire [5:0] since = now - code;
        wire carry;
        initial data[line_of] = 0;
        always @(posedge clk) data[line_of] <= !code[5] && !since[4];
        hc595 first (.clk(clk), .data(data[line_of]), .shift(shift), .latch(latch),
                     .outputs(pins[16*line_of +: 8]), .carry(carry));
        hc595 above (.clk(clk), .data(carry), .shift(shift), .latch(latch_above),
                     .outputs(pins[16*line_of+8 +: 8]), .carry());
    end endgenerate
endmodule

// A shift register; shift and latch are enables of the board's clock here, and edges at a real one.
module hc595 (
    input clk,
    input data,
    input shift,
    input latch,
    output reg [7:0] outputs,
    output carry
);
    reg [7:0] held = 0;
    initial outputs = 0;
    always @(posedge clk) begin
        if (shift) held <= {held[6:0], data};
        if (latch) outputs <= held;
    end
    assign carry = held[7];
endmodule
